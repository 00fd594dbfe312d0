"""The applet's parameters as data: what each means, its unit, default and range.

The applet carries the same table (a test compares the two). Ranges are what the applet accepts at the
switch; beyond them it refuses in words.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

PREFIX = "SWP_"
AUX_FUNCTION = 300  # RCx_OPTION Scripting1, also for MAV_CMD_DO_AUX_FUNCTION
# us: an auxiliary switch is low below, high above (RC_Channel.cpp, 4.6.3)
SWITCH_LOW, SWITCH_HIGH = 1200, 1800


@dataclass(frozen=True)
class AppletParameter:
    """One SWP_ parameter, in `unit` ("" for none), accepted from `low` to `high`."""

    name: str
    unit: str
    default: float
    low: float
    high: float
    meaning: str


PARAMETERS: tuple[AppletParameter, ...] = (
    AppletParameter("SWP_ENABLE", "", 1, 0, 1, "0 refuses every run and stops the one that goes on"),
    AppletParameter(
        "SWP_TYPE", "", 0, 0, 4, "manoeuvre: 0 sweep, 1 doublet, 2 multisine, 3 bias sweep, 4 throttle sweep"
    ),
    AppletParameter(
        "SWP_AMP", "us", 150, 1, 500, "amplitude (multisine: peak) of the steering or throttle PWM"
    ),
    AppletParameter(
        "SWP_WMIN", "rad/s", 0.3, 0.05, 50, "frequency at which the sweep begins; lower end of a multisine"
    ),
    AppletParameter(
        "SWP_WMAX", "rad/s", 25, 0.1, 100, "frequency at which the sweep ends; upper end of a multisine"
    ),
    AppletParameter("SWP_TREC", "s", 55, 1, 600, "length of the law, without fades and dwell"),
    AppletParameter("SWP_FADE", "s", 2, 0, 20, "fade-in and fade-out, each; a doublet has none"),
    AppletParameter(
        "SWP_DWELL", "s", 2, 0, 60, "full amplitude before the law begins, of a sweep at SWP_WMIN"
    ),
    AppletParameter("SWP_STRAIGHT", "s", 3, 0, 30, "straight at trim before and after, each"),
    AppletParameter("SWP_STILL", "s", 3, 0, 30, "standstill recorded before and after; 0 waits for none"),
    AppletParameter("SWP_PULSE", "s", 1, 0.1, 10, "doublet: length of each of its two steps"),
    AppletParameter("SWP_PAUSE", "s", 2, 0, 30, "doublet: pause after each"),
    AppletParameter("SWP_COUNT", "", 2, 1, 20, "doublet: how many; multisine: periods in SWP_TREC"),
    AppletParameter(
        "SWP_PWM_MAX",
        "us",
        250,
        1,
        500,
        "steering limit from trim, throttle limit from the pilot's: refused, and stopped, past it",
    ),
    AppletParameter("SWP_ROLL_MAX", "deg", 30, 1, 90, "stop at a roll angle past this"),
    AppletParameter("SWP_P_MAX", "deg/s", 200, 1, 2000, "stop at a roll rate past this"),
    AppletParameter("SWP_R_MAX", "deg/s", 150, 1, 2000, "stop at a yaw rate past this"),
    AppletParameter(
        "SWP_V_MIN", "m/s", 0.5, 0, 30, "speed from which a run starts, and below which it stops"
    ),
    AppletParameter(
        "SWP_V_MAX", "m/s", 4, 0.1, 50, "speed up to which a run starts, and above which it stops"
    ),
    AppletParameter("SWP_GCS", "", 0, 0, 1, "1 stops when the ground station was not heard for 3 s"),
    AppletParameter(
        "SWP_CHAN", "", 0, 0, 16, "switch: 0 the RC channel with RCx_OPTION 300, else this raw RC channel"
    ),
    AppletParameter("SWP_RUN", "", 0, 0, 65535, "number of the last run; counted by the applet"),
    AppletParameter("SWP_BIAS", "us", 0, -400, 400, "bias sweep: offset from trim about which it steers"),
    AppletParameter(
        "SWP_GO",
        "",
        0,
        0,
        65535,
        "go number: the ground station draws a new one for each run that was asked for",
    ),
    AppletParameter(
        "SWP_THR", "us", 0, 0, 2000, "throttle of a ground station that drives and is watched; 0: it does not"
    ),
    AppletParameter(
        "SWP_LAPSE", "s", 0, 0, 3, "RC_OVERRIDE_TIME while a ground station overrides; 0: none does"
    ),
    AppletParameter(
        "SWP_BACK", "s", 3, -1, 3600, "RC_OVERRIDE_TIME before and after that; set by the applet"
    ),
    AppletParameter("SWP_VER", "", 0, 0, 100, "version of the applet that runs; set by the applet"),
)

TYPES: Mapping[str, int] = MappingProxyType(
    {"sweep": 0, "doublet": 1, "multisine": 2, "bias_sweep": 3, "throttle": 4}
)

STATES: Mapping[int, str] = MappingProxyType(
    {
        0: "idle",
        1: "standstill before",
        2: "waiting for speed",
        3: "straight before",
        4: "fade-in",
        5: "dwell",
        6: "manoeuvre",
        7: "fade-out",
        8: "straight after",
        9: "standstill after",
        10: "stopped",
    }
)
"""Field St of the log messages SWEP, SWET and value of SWP_ST; the applet steers or drives in 3 to 8."""

_NOT_OF_A_MANOEUVRE = ("SWP_TYPE", "SWP_RUN", "SWP_GO", "SWP_THR", "SWP_LAPSE", "SWP_BACK", "SWP_VER")
_FIELDS = {
    "amplitude": "SWP_AMP",
    "w_min": "SWP_WMIN",
    "w_max": "SWP_WMAX",
    "t_rec": "SWP_TREC",
    "periods": "SWP_COUNT",
} | {p.name.removeprefix(PREFIX).lower(): p.name for p in PARAMETERS if p.name not in _NOT_OF_A_MANOEUVRE}


def for_manoeuvre(kind: str, **numbers: float) -> dict[str, float]:
    """SWP_ values of a manoeuvre: kind of TYPES, and any of its numbers.

    Numbers are named amplitude, bias [us], w_min, w_max [rad/s], t_rec, fade, dwell, straight, pulse,
    pause [s], count or periods, or as a parameter in lower case without prefix (still, v_min, pwm_max,
    gcs...). Raises ValueError for an unknown name or kind, or a number that the applet would refuse.
    """
    if kind not in TYPES:
        raise ValueError(f"the applet has no manoeuvre {kind!r}, only {', '.join(TYPES)}")
    unknown = sorted(set(numbers) - set(_FIELDS))
    if unknown:
        raise ValueError(
            f"the applet has no parameter for {', '.join(unknown)}; it knows {', '.join(_FIELDS)}"
        )
    values = {"SWP_TYPE": float(TYPES[kind])} | {_FIELDS[name]: float(x) for name, x in numbers.items()}
    for parameter in PARAMETERS:
        value = values.get(parameter.name, parameter.default)
        if not parameter.low <= value <= parameter.high:
            allowed = f"{parameter.low:g} to {parameter.high:g}"
            raise ValueError(f"{parameter.name} {value:g} {parameter.unit} is outside {allowed}")
    return values


_VERSION = re.compile(r'^local VERSION = "(.*)"$', re.MULTILINE)


def version_of(text: str) -> str:
    """The version stated in an applet's text, '' if none."""
    found = _VERSION.search(text)
    return found[1] if found else ""


def applet_version() -> float:
    """Version of the shipped applet, as it reports it in SWP_VER."""
    return float(version_of(applet_source()))


def applet_path() -> Path:
    """The applet's file, to be copied into the vehicle's scripts folder."""
    return Path(__file__).with_name("rover_sweep.lua")


def applet_source() -> str:
    """The applet's text."""
    return applet_path().read_text(encoding="utf-8")
