"""The rules of a vehicle file: keys, units, examples, and checks of the values.

Each check returns sentences, so that all problems of a file are reported together.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rover_sweep.data.geometry import Tolerances

# [material] of the vehicle file: normal tolerances; a smaller deviation is not reported as a finding.
#
# For a quantity fitted within bounds the size is the bound. For one with a Gaussian prior it is two standard
# deviations of the prior. The standard deviation of a number that the vehicle file has, if written there,
# wins.


@dataclass(frozen=True)
class MaterialSize:
    """A key of [material]. field: of `Tolerances`; deviations: size over that field; most: largest size.

    A field of a length is a share of the wheelbase.
    """

    unit: str
    meaning: str
    field: str
    deviations: float
    most: float

    @property
    def default(self) -> float:
        """The default size, in `unit`; a length is that of a wheelbase of 0.5 m."""
        wheelbase = 0.5 if self.unit == "m" else 1.0
        return float(self.deviations * wheelbase * getattr(Tolerances(), self.field))


MATERIAL: dict[str, MaterialSize] = {
    "servo_lag": MaterialSize("s", "lag of the steering servo", "lag", 1, 0.5),
    "transport_delay": MaterialSize("s", "delay from command to wheel", "delay", 1, 0.5),
    "lag_and_delay": MaterialSize("s", "lag and delay together", "together", 1, 1.0),
    "front_rear_stiffness": MaterialSize("-", "ln(Cf/Cr), so .15 is 15 %", "ratio", 1, 1.6),
    "lateral_bias": MaterialSize("m/s^2", "steady a_y", "bias_ay", 1, 5.0),
    "steering_trim": MaterialSize("rad", "road-wheel angle at trim_us", "trim", 1, 0.3),
    "steering_scale": MaterialSize("-", "share of rad_per_us", "scale", 2, 0.5),
    "speed_scale": MaterialSize("-", "share of the measured speed", "speed", 2, 0.5),
    "cg_position": MaterialSize("m", "CG along the rover", "cg", 2, 1.0),
    "cg_height_share": MaterialSize("-", "share of cg_height_above_roll_centre", "h", 2, 1.0),
    "roll_inertia_share": MaterialSize("-", "share of roll_inertia", "roll_inertia", 2, 1.0),
    "imu_position": MaterialSize("m", "place of the IMU", "imu_x", 2, 1.0),
    "sensor_lag": MaterialSize("s", "lag of a_y or p beyond the known filters", "sensor_lag", 2, 0.2),
    "velocity_scale": MaterialSize("-", "share of the EKF's V_y", "velocity_gain", 2, 1.0),
    "velocity_lag": MaterialSize("s", "lag of the EKF's velocity", "velocity_lag", 1, 1.0),
}


def read_material(table: Mapping[str, Any]) -> tuple[dict[str, float], list[str]]:
    """({key: size}, a sentence for each problem) of the table [material], unknown keys ignored."""
    sizes, problems = {}, []
    for key, entry in table.items():
        if (rule := MATERIAL.get(key)) is None:
            continue
        unit = "" if rule.unit == "-" else f" {rule.unit}"
        example = f"as in: {key} = {rule.default:g}{f'  #{unit}' if unit else ''}"
        if isinstance(entry, bool) or not isinstance(entry, int | float):
            problems.append(f"[material] {key} is {entry!r}; it must be a plain number, {example}")
        elif not 0 < entry <= rule.most:
            above = f"above 0 and at most {rule.most:g}{unit}"
            problems.append(f"[material] {key} is {entry:g}{unit}; it must be {above}, {example}")
        else:
            sizes[key] = float(entry)
    return sizes, problems


@dataclass(frozen=True)
class Key:
    """A number of the file. sign: +1 must be above 0, 0 any sign."""

    unit: str
    meaning: str
    example: str
    sign: int = 1
    required: bool = False


# {`how` of a number: its standard deviation over the value; of "ruler" over the wheelbase}
HOW = {"scale": 0.01, "ruler": 0.02, "swing": 0.10, "bench": 0.03, "guess": 0.30}

KEYS: dict[str, Key] = {
    "vehicle.mass": Key("kg", "mass, ready to drive", "mass = 2.66  # kg", required=True),
    "vehicle.cg_to_front_axle": Key(
        "m", "CG to front axle, a", "cg_to_front_axle = 0.203  # m", required=True
    ),
    "vehicle.cg_to_rear_axle": Key("m", "CG to rear axle, b", "cg_to_rear_axle = 0.188  # m", required=True),
    "vehicle.sprung_mass": Key("kg", "mass carried by the springs", "sprung_mass = 2.40  # kg"),
    "vehicle.cg_height_above_roll_centre": Key(
        "m", "sprung CG over roll axis", "cg_height_above_roll_centre = 0.058  # m", sign=0
    ),
    "vehicle.roll_inertia": Key("kg m^2", "sprung mass about own CG", "roll_inertia = 0.0125  # kg m^2"),
    "vehicle.yaw_inertia": Key("kg m^2", "whole vehicle about CG", "yaw_inertia = 0.069  # kg m^2"),
    "vehicle.roll_yaw_inertia": Key(
        "kg m^2", "product of inertia Ixz", "roll_yaw_inertia = 0.0  # kg m^2", sign=0
    ),
    "vehicle.friction": Key("-", "peak side force over load", "friction = 0.8"),
    "vehicle.max_steering_angle": Key(
        "rad", "road-wheel angle at the end stops", "max_steering_angle = 0.34  # rad"
    ),
    "steering.trim_us": Key("us", "PWM that drives straight", "trim_us = 1500  # us", required=True),
    "steering.rad_per_us": Key(
        "rad/us", "road-wheel angle per us", "rad_per_us = 0.00095  # rad/us", sign=0, required=True
    ),
    "steering.asymmetry": Key("-", "gain 1+e left, 1-e right", "asymmetry = 0.02", sign=0),
    "steering.nonlinearity": Key("1/rad^2", "gain 1 + c3 u^2", "nonlinearity = 0.5  # 1/rad^2", sign=0),
    "steering.deadband": Key("rad", "half width of the dead band", "deadband = 0.002  # rad", sign=0),
    "steering.backlash": Key("rad", "half gap at the road wheel", "backlash = 0.004  # rad", sign=0),
    "steering.servo_lag": Key("s", "first-order lag of the servo", "servo_lag = 0.025  # s", sign=0),
    "steering.servo_delay": Key("s", "output to first movement", "servo_delay = 0.015  # s", sign=0),
    "steering.servo_rate_limit": Key(
        "rad/s", "fastest rate of the road wheel", "servo_rate_limit = 6.0  # rad/s"
    ),
}
SECTIONS: dict[str, tuple[str, ...]] = {
    "vehicle": ("name", *(key.partition(".")[2] for key in KEYS if key.startswith("vehicle."))),
    "steering": tuple(key.partition(".")[2] for key in KEYS if key.startswith("steering.")),
    "imu": ("position",),
    "fit": ("free",),
    "material": tuple(MATERIAL),
}
NEVER_FREE = ("name", "friction", "max_steering_angle")
FREE_KEYS = tuple(key for key in SECTIONS["vehicle"] if key not in NEVER_FREE)
SYMBOLS = {
    "a": "cg_to_front_axle",
    "b": "cg_to_rear_axle",
    "h": "cg_height_above_roll_centre",
    "m": "mass",
    "ms": "sprung_mass",
    "ixx": "roll_inertia",
    "ixz": "roll_yaw_inertia",
    "izz": "yaw_inertia",
    "mu": "friction",
    "trim": "trim_us",
}

WHEELBASE = (0.05, 5.0)  # m
TRIM = (800.0, 2200.0)  # us, range of a servo output
LARGEST_LOCK = 60.0  # deg of road-wheel angle at 500 us
SMALLEST_LOCK = 1.0
# Largest values of what `bench` measures; above them the unit is probably the one named.
LARGEST_OF_STEERING = {
    "asymmetry": (0.6, "percent? give a ratio"),
    "nonlinearity": (30.0, "per degree squared? give 1/rad^2"),
    "deadband": (0.2, "degrees? give radians"),
    "backlash": (0.2, "degrees? give radians"),
    "servo_lag": (0.5, "milliseconds? give seconds"),
    "servo_delay": (0.5, "milliseconds? give seconds"),
    "servo_rate_limit": (100.0, "degrees per second? give rad/s"),
}
EITHER_SIGN = ("asymmetry", "nonlinearity")
LARGEST_FRICTION = 2.0
LARGEST_SD = 0.5  # m; a length that is less certain was not measured
DENSEST = 5000.0  # kg/m^3, mass over wheelbase cubed; rovers and cars have 20..200


def unknown_keys(data: Mapping[str, Any]) -> list[str]:
    """A sentence for each unknown section or key, with the closest known one."""
    problems = []
    for section, content in data.items():
        if section not in SECTIONS:
            problems.append(_unknown_section(section, content))
        elif not isinstance(content, dict):
            problems.append(f"{section} must be a section, written as a line [{section}]")
        else:
            problems += [_unknown_key(section, key) for key in content if key not in SECTIONS[section]]
    return problems


def _unknown_section(section: str, content: Any) -> str:
    if not isinstance(content, dict):
        owner = _owner(section)
        return f"{section} is outside a section" + (f"; it belongs under [{owner}]" if owner else "")
    near = difflib.get_close_matches(section.lower(), SECTIONS, 1, 0.5)
    return f"there is no section [{section}]" + (
        f"; did you mean [{near[0]}]?"
        if near
        else f"; the sections are {', '.join(f'[{s}]' for s in SECTIONS)}"
    )


def _unknown_key(section: str, key: str) -> str:
    owner = _owner(key)
    if owner:
        return f"[{section}] {key} belongs under [{owner}]"
    everywhere = {name: s for s, names in SECTIONS.items() for name in names}
    near = SYMBOLS.get(key.lower()) or next(
        iter(difflib.get_close_matches(key.lower(), SECTIONS[section], 1, 0.55)),
        next(iter(difflib.get_close_matches(key.lower(), everywhere, 1, 0.55)), None),
    )
    if near is None:
        return f"[{section}] {key} is not known; [{section}] may have {', '.join(SECTIONS[section])}"
    where = "" if near in SECTIONS[section] else f" under [{everywhere[near]}]"
    return f"[{section}] {key} is not known; did you mean {near}{where}?"


def _owner(key: str) -> str | None:
    return next((section for section, names in SECTIONS.items() if key in names), None)


def read_number(
    entry: Any, where: str, rule: Key | None
) -> tuple[tuple[float, float | None, str] | None, list[str]]:
    """((value, sd, how), complaints) of a TOML entry; the first is None if it is not a valid number."""
    value, sd, how = entry, None, None
    if isinstance(entry, dict):
        extra = [key for key in entry if key not in ("value", "sd", "how")]
        if extra or "value" not in entry:
            wrong = f"has {', '.join(extra)}" if extra else "has no value"
            return None, [f"{where} {wrong}; write {{ value = .., sd = .. }}"]
        value, sd, how = entry["value"], entry.get("sd"), entry.get("how")
    example = f", such as: {rule.example}" if rule else " in metres"
    if not _is_number(value):
        quotes = " in quotes" if isinstance(value, str) else ""
        return None, [f"{where} is {value!r}{quotes}; it must be a plain number{example}"]
    complaints = []
    if rule and rule.sign > 0 and value <= 0:
        complaints.append(f"{where} is {value:g} {rule.unit}; it must be above 0")
    if sd is not None and (not _is_number(sd) or sd < 0):
        complaints.append(f"{where}: sd is {sd!r}; it must be a number, 0 or above")
    elif sd is not None and rule and (rule.sign > 0 or rule.required) and 0 < abs(value) < sd:
        complaints.append(
            f"{where}: sd {sd:g} is above the value {value:g}; sd is in {rule.unit}, not percent"
        )
    elif sd is not None and (rule is None or rule.unit == "m") and sd > LARGEST_SD:
        complaints.append(f"{where}: sd is {sd:g} m; millimetres or centimetres? give metres")
    if how is not None:
        complaints += _of_how(how, where, value if rule else 0.0, sd, rule.unit if rule else "m")
    return (
        (None, complaints) if complaints else ((float(value), sd if sd is None else float(sd), how or ""), [])
    )


def _of_how(how: Any, where: str, value: float, sd: Any, unit: str) -> list[str]:
    """A sentence if `how` is unknown or gives no standard deviation of this number."""
    if not isinstance(how, str) or how not in HOW:
        words = ", ".join(f'"{word}"' for word in HOW)
        return [f"{where}: how is {how!r}; write one of {words}, or sd = .. in its place"]
    if sd is not None:
        return [f"{where} has sd and how; write only one of them"]
    if how == "ruler" and unit != "m":
        return [f'{where}: how is "ruler", which is for lengths; this number is in {unit}']
    if how != "ruler" and not value:
        return [f'{where}: how = "{how}" is a share of the value, which may be 0; write sd = ..']
    return []


def _is_number(entry: Any) -> bool:
    return isinstance(entry, int | float) and not isinstance(entry, bool) and math.isfinite(entry)


def inconsistencies(values: Mapping[str, float], imu: tuple[float, ...] | None) -> list[str]:
    """Sentences on numbers that contradict each other. values: {dotted key: value}; imu [m]."""
    v = {key.partition(".")[2]: value for key, value in values.items()}
    return [*_masses(v), *_lengths(v, imu), *_inertias(v), *_friction(v), *_steering(v)]


def _wheelbase(v: Mapping[str, float]) -> float | None:
    """a + b [m] if both are given and plausible, else None, so that one mistake is reported once."""
    if "cg_to_front_axle" not in v or "cg_to_rear_axle" not in v:
        return None
    wheelbase = v["cg_to_front_axle"] + v["cg_to_rear_axle"]
    return wheelbase if WHEELBASE[0] <= wheelbase <= WHEELBASE[1] else None


def _masses(v: Mapping[str, float]) -> list[str]:
    mass, sprung, wheelbase = v.get("mass"), v.get("sprung_mass"), _wheelbase(v)
    if mass and wheelbase and mass / wheelbase**3 > DENSEST:
        return [
            f"[vehicle] mass {mass:g} kg is too much for a wheelbase of {wheelbase:.3g} m; grams? give kg"
        ]
    if mass and sprung and sprung > mass:
        return [
            f"[vehicle] sprung_mass {sprung:g} kg is above mass {mass:g} kg; "
            "it is the part of the mass that the springs carry"
        ]
    return []


def _lengths(v: Mapping[str, float], imu: tuple[float, ...] | None) -> list[str]:
    problems = []
    if "cg_to_front_axle" in v and "cg_to_rear_axle" in v and _wheelbase(v) is None:
        a, b = v["cg_to_front_axle"], v["cg_to_rear_axle"]
        unit = "centimetres or millimetres? give metres" if a + b > 1 else "lengths are in metres"
        problems.append(
            f"[vehicle] cg_to_front_axle {a:g} and cg_to_rear_axle {b:g} make a wheelbase of {a + b:g} m, "
            f"outside {WHEELBASE[0]:g}..{WHEELBASE[1]:g} m; {unit}"
        )
    reach = _wheelbase(v) or WHEELBASE[1]
    h = v.get("cg_height_above_roll_centre")
    if h is not None and abs(h) > reach:
        problems.append(
            f"[vehicle] cg_height_above_roll_centre {h:g} m is more than the vehicle is long; "
            "centimetres? give metres"
        )
    if imu and max(abs(x) for x in imu) > 2 * reach:
        problems.append(
            f"[imu] position {list(imu)} m is outside the vehicle; centimetres? give metres from the CG"
        )
    return problems


def _inertias(v: Mapping[str, float]) -> list[str]:
    """Checks that the radius of gyration sqrt(I/m) is below the wheelbase."""
    problems = []
    for key, mass_key in (("roll_inertia", "sprung_mass"), ("yaw_inertia", "mass")):
        inertia, mass, wheelbase = v.get(key), v.get(mass_key) or v.get("mass"), _wheelbase(v)
        if inertia and mass and wheelbase and (radius := math.sqrt(inertia / mass)) > wheelbase:
            problems.append(
                f"[vehicle] {key} {inertia:g} kg m^2 means a radius of gyration of {radius:.2g} m, above "
                f"the wheelbase of {wheelbase:.3g} m; kg cm^2 or g m^2? give kg m^2"
            )
    return problems


def _friction(v: Mapping[str, float]) -> list[str]:
    friction = v.get("friction")
    if friction is None or friction <= LARGEST_FRICTION:
        return []
    return [f"[vehicle] friction {friction:g} is too large for a tyre; percent? give a ratio, 0.3..1.2"]


def _steering(v: Mapping[str, float]) -> list[str]:
    problems = []
    trim, scale = v.get("trim_us"), v.get("rad_per_us")
    if trim is not None and not TRIM[0] <= trim <= TRIM[1]:
        problems.append(
            f"[steering] trim_us is {trim:g} us, outside {TRIM[0]:g}..{TRIM[1]:g} us; "
            "it is the PWM at which the rover drives straight"
        )
    lock = None if scale is None else math.degrees(abs(scale) * 500)
    if lock is not None and lock > LARGEST_LOCK:
        problems.append(
            f"[steering] rad_per_us {scale:g} turns the wheels by {lock:.0f} deg at 500 us; "
            "degrees per us? give radians per us"
        )
    elif lock is not None and lock < SMALLEST_LOCK:
        problems.append(
            f"[steering] rad_per_us {scale:g} turns the wheels by only {lock:.2g} deg at 500 us; "
            "rovers have 15..45 deg, which is 0.0005..0.0016 rad/us"
        )
    return problems + _bench(v)


def _bench(v: Mapping[str, float]) -> list[str]:
    problems = []
    for key, (largest, slip) in LARGEST_OF_STEERING.items():
        if key not in v:
            continue
        unit = KEYS[f"steering.{key}"].unit
        if abs(v[key]) > largest:
            problems.append(f"[steering] {key} is {v[key]:g}, above {largest:g} {unit}; {slip}")
        elif v[key] < 0 and key not in EITHER_SIGN:
            problems.append(f"[steering] {key} is {v[key]:g} {unit}; it cannot be below 0")
    return problems
