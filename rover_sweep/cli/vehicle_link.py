"""Options and link of the commands that only read or set a vehicle, without driving it."""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.options import FILE, gathered, option
from rover_sweep.cli.views.asking import chosen_of
from rover_sweep.cli.views.output import echo, narration
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Manoeuvre, Sweep, ThrottleSweep

if TYPE_CHECKING:
    from rover_sweep.vehicle.link.connection import Access, Heard
    from rover_sweep.vehicle.link.link import Link

# Options that choose the vehicle at --connect; if several are heard, the user is asked.


def _access(
    connect: str | None,
    system: int | None = option(
        "MAVLink system id of the vehicle, if several are heard.", click.IntRange(1, 255), "N"
    ),
    signing_key: str | None = option(
        "File with the MAVLink signing key: 32 bytes, 64 hex digits, or a passphrase "
        "(its SHA-256 is the key, as in Mission Planner).",
        FILE,
    ),
) -> Access:
    """Of a command with --connect. UsageError for these options without it."""
    from rover_sweep.vehicle.link.connection import Access
    from rover_sweep.vehicle.link.mavlink import read_key

    given = "--system" if system is not None else "--signing-key" if signing_key else ""
    if given and connect is None:
        raise UsageError(f"{given} needs --connect; give --connect too")
    choose = _ask_system if sys.stdin.isatty() else None
    return Access(system, choose, _warn, read_key(Path(signing_key)) if signing_key else None)


ACCESS = gathered(_access)


def _ask_system(heard: Sequence[Heard]) -> int:
    echo(f"{len(heard)} vehicles are heard:", err=True)
    for one in heard:
        echo(f"  {one}", err=True)
    return int(chosen_of("Which system?", [str(one.system) for one in heard]))


def _warn(sentence: str) -> None:
    narration().print(sentence, style="yellow", soft_wrap=True)


# Manoeuvres and limits on the command line: 150 or 150,0.3,25,55 or 150,wmax=20; roll_max=20.


_SWEEP = {
    "amplitude": "amplitude",
    "wmin": "w_min",
    "wmax": "w_max",
    "trec": "t_rec",
    "fade": "fade",
    "dwell": "dwell",
    "straight": "straight",
}
_DOUBLET = {name: name for name in ("amplitude", "pulse", "pause", "count", "straight")}
_MULTISINE = dict(list(_SWEEP.items())[:4]) | {"periods": "periods"} | dict(list(_SWEEP.items())[4:])
_BIAS_SWEEP = {"amplitude": "amplitude", "bias": "bias"} | _SWEEP
_KEYS: dict[type[Manoeuvre], tuple[dict[str, str], int]] = {  # names in order, number of them shown in --help
    Sweep: (_SWEEP, 4),
    Doublet: (_DOUBLET, 3),
    Multisine: (_MULTISINE, 5),
    BiasSweep: (_BIAS_SWEEP, 5),
    ThrottleSweep: (_SWEEP, 4),
}
_WHOLE = ("count", "periods")
LIMITS = ("pwm_max", "roll_max", "p_max", "r_max", "v_min", "v_max", "still", "gcs")


class ManoeuvreType(click.ParamType):
    """A manoeuvre: its numbers in their order, or by name, joined by commas."""

    def __init__(self, kind: type[Manoeuvre]) -> None:
        self.kind = kind
        self.keys, shown = _KEYS[kind]
        first = [name.upper() for name in list(self.keys)[:shown]]
        self.name = f"{first[0]}[,{','.join(first[1:])}]"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> Manoeuvre:
        """The manoeuvre; a usage error that names the wrong part."""
        if isinstance(value, Manoeuvre):
            return value
        numbers: dict[str, float] = {}
        for key, part in zip(self.keys, str(value).split(","), strict=False):
            name, _, text = part.rpartition("=")
            name = name.strip().lower() or key
            if name not in self.keys:
                self.fail(f"{value!r}: there is no {name!r}; there are {', '.join(self.keys)}", param, ctx)
            numbers[self.keys[name]] = self._number(text, str(value), param, ctx)
        if len(str(value).split(",")) > len(self.keys):
            self.fail(f"{value!r} has more numbers than {', '.join(self.keys)}", param, ctx)
        for name in (name for name in _WHOLE if name in numbers):
            if not numbers[name].is_integer():
                self.fail(f"{value!r}: {name} must be a whole number", param, ctx)
            numbers[name] = int(numbers[name])
        try:
            return self.kind(**numbers)  # type: ignore[arg-type]
        except ValueError as error:
            self.fail(str(error), param, ctx)

    def _number(
        self, text: str, whole: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            self.fail(
                f"{whole!r}: {text!r} is not a number; write it as 150,0.3,25,55 or 150,wmax=20", param, ctx
            )
        return number


class LimitType(click.ParamType):
    """A limit of the applet by its name without SWP_, e.g. roll_max=20."""

    name = "NAME=VALUE"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        """(name, value)."""
        name, _, text = str(value).partition("=")
        name = name.strip().lower().removeprefix("swp_")
        if name not in LIMITS:
            self.fail(f"{value!r}: there is no limit {name!r}; there are {', '.join(LIMITS)}", param, ctx)
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            self.fail(f"{value!r}: {text!r} is not a number", param, ctx)
        return name, number


URL_HELP = "tcp:HOST:PORT, udp:HOST:PORT (listen), or /dev/ttyACM0,115200."

PILOT_PATIENCE = 900.0  # s to wait for the pilot to arm, throw the switch, or disarm at the end


def throw_switch_option(meaning: str) -> Any:
    """--throw-switch, by RC override without a value; meaning: the help text."""
    return option(meaning, click.Choice(["override", "aux", "pilot"]), is_flag=False, flag_value="override")


CONNECT = option(URL_HELP, None, "URL", required=True)
JSON_ALONE = option("Print JSON on stdout, and nothing else there.", flag="--json")
LIMIT_SET = option(
    "Limit of the applet, e.g. v_max=3. [default: as set on the rover]", LimitType(), multiple=True
)
ARM = option("Allow this program to arm and disarm the rover.")
THROTTLE_PWM = click.IntRange(1000, 2000)
SWITCH_AS_RUN = throw_switch_option("Allow this program to throw the applet's switch, as in `run`.")
THROTTLE = option("With --arm: allow this program to drive, with this throttle PWM.", THROTTLE_PWM, "US")


def via_option(meaning: str) -> Any:
    """--via, the library that talks to the vehicle; meaning: the help text."""
    return option(meaning, click.Choice(["mavlink", "mavsdk"]), default="mavlink")


@contextmanager
def unkept_link(url: str, access: Access) -> Iterator[Link]:
    """A link whose recording is deleted at the end; not for driving."""
    from rover_sweep.vehicle.link.link import Link

    with (
        tempfile.TemporaryDirectory() as folder,
        Link.open(url, Path(folder) / "unkept.tlog", access=access) as link,
    ):
        yield link
