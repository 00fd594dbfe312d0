"""The rules of a vehicle file: keys, units, examples, and checks of the values.

Each check returns sentences, so that all problems of a file are reported together.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping
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
    """A number of the file, with a usual value. sign: +1 must be above 0, 0 any sign."""

    name: str
    unit: str
    meaning: str
    usual: str
    sign: int = 1
    required: bool = False

    @property
    def example(self) -> str:
        """A line of the file."""
        return f"{self.name} = {self.usual}{'' if self.unit == '-' else f'  # {self.unit}'}"


# {`how` of a number: its standard deviation over the value; of "ruler" over the wheelbase}
HOW = {"scale": 0.01, "ruler": 0.02, "swing": 0.10, "bench": 0.03, "guess": 0.30}

OF_VEHICLE = (
    Key("mass", "kg", "mass, ready to drive", "2.66", required=True),
    Key("cg_to_front_axle", "m", "CG to front axle, a", "0.203", required=True),
    Key("cg_to_rear_axle", "m", "CG to rear axle, b", "0.188", required=True),
    Key("sprung_mass", "kg", "mass carried by the springs", "2.40"),
    Key("cg_height_above_roll_centre", "m", "sprung CG over roll axis", "0.058", 0),
    Key("roll_inertia", "kg m^2", "sprung mass about own CG", "0.0125"),
    Key("yaw_inertia", "kg m^2", "whole vehicle about CG", "0.069"),
    Key("roll_yaw_inertia", "kg m^2", "product of inertia Ixz", "0.0", 0),
    Key("friction", "-", "peak side force over load", "0.8"),
    Key("max_steering_angle", "rad", "road-wheel angle at the end stops", "0.34"),
)
OF_STEERING = (
    Key("trim_us", "us", "PWM that drives straight", "1500", required=True),
    Key("rad_per_us", "rad/us", "road-wheel angle per us", "0.00095", 0, required=True),
    Key("asymmetry", "-", "gain 1+e left, 1-e right", "0.02", 0),
    Key("nonlinearity", "1/rad^2", "gain 1 + c3 u^2", "0.5", 0),
    Key("deadband", "rad", "half width of the dead band", "0.002", 0),
    Key("backlash", "rad", "half gap at the road wheel", "0.004", 0),
    Key("servo_lag", "s", "first-order lag of the servo", "0.025", 0),
    Key("servo_delay", "s", "output to first movement", "0.015", 0),
    Key("servo_rate_limit", "rad/s", "fastest rate of the road wheel", "6.0"),
)
KEYS = {f"vehicle.{k.name}": k for k in OF_VEHICLE} | {f"steering.{k.name}": k for k in OF_STEERING}
SECTIONS: dict[str, tuple[str, ...]] = {
    "vehicle": ("name", *(key.name for key in OF_VEHICLE)),
    "steering": tuple(key.name for key in OF_STEERING),
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
        if section in SECTIONS and isinstance(content, dict):
            problems += [_unknown_key(section, key) for key in content if key not in SECTIONS[section]]
        elif section in SECTIONS:
            problems.append(f"{section} must be a section, written as a line [{section}]")
        elif not isinstance(content, dict):
            owner = _owner(section)
            problems.append(
                f"{section} is outside a section" + (f"; it belongs under [{owner}]" if owner else "")
            )
        else:
            near = difflib.get_close_matches(section.lower(), SECTIONS, 1, 0.5)
            meant = (
                f"did you mean [{near[0]}]?"
                if near
                else f"the sections are {', '.join(f'[{s}]' for s in SECTIONS)}"
            )
            problems.append(f"there is no section [{section}]; {meant}")
    return problems


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
    return [*_of_vehicle(v, imu), *_of_steering(v)]


def _of_vehicle(v: Mapping[str, float], imu: tuple[float, ...] | None) -> Iterator[str]:
    a, b = v.get("cg_to_front_axle"), v.get("cg_to_rear_axle")
    whole = None if a is None or b is None else a + b
    # None where it is implausible, so that one mistake is reported once
    wheelbase = whole if whole is not None and WHEELBASE[0] <= whole <= WHEELBASE[1] else None
    mass, sprung = v.get("mass"), v.get("sprung_mass")
    if mass and wheelbase and mass / wheelbase**3 > DENSEST:
        yield f"[vehicle] mass {mass:g} kg is too much for a wheelbase of {wheelbase:.3g} m; grams? give kg"
    elif mass and sprung and sprung > mass:
        yield (
            f"[vehicle] sprung_mass {sprung:g} kg is above mass {mass:g} kg; "
            "it is the part of the mass that the springs carry"
        )
    if whole is not None and wheelbase is None:
        unit = "centimetres or millimetres? give metres" if whole > 1 else "lengths are in metres"
        yield (
            f"[vehicle] cg_to_front_axle {a:g} and cg_to_rear_axle {b:g} make a wheelbase of {whole:g} m, "
            f"outside {WHEELBASE[0]:g}..{WHEELBASE[1]:g} m; {unit}"
        )
    reach, h = wheelbase or WHEELBASE[1], v.get("cg_height_above_roll_centre")
    if h is not None and abs(h) > reach:
        yield (
            f"[vehicle] cg_height_above_roll_centre {h:g} m is more than the vehicle is long; "
            "centimetres? give metres"
        )
    if imu and max(abs(x) for x in imu) > 2 * reach:
        yield f"[imu] position {list(imu)} m is outside the vehicle; centimetres? give metres from the CG"
    for key, of in (("roll_inertia", v.get("sprung_mass") or mass), ("yaw_inertia", mass)):
        inertia = v.get(key)
        if inertia and of and wheelbase and (radius := math.sqrt(inertia / of)) > wheelbase:
            yield (
                f"[vehicle] {key} {inertia:g} kg m^2 means a radius of gyration of {radius:.2g} m, above "
                f"the wheelbase of {wheelbase:.3g} m; kg cm^2 or g m^2? give kg m^2"
            )
    if (friction := v.get("friction", 0.0)) > LARGEST_FRICTION:
        yield f"[vehicle] friction {friction:g} is too large for a tyre; percent? give a ratio, 0.3..1.2"


def _of_steering(v: Mapping[str, float]) -> Iterator[str]:
    trim, scale = v.get("trim_us"), v.get("rad_per_us")
    if trim is not None and not TRIM[0] <= trim <= TRIM[1]:
        yield (
            f"[steering] trim_us is {trim:g} us, outside {TRIM[0]:g}..{TRIM[1]:g} us; "
            "it is the PWM at which the rover drives straight"
        )
    lock = None if scale is None else math.degrees(abs(scale) * 500)
    if lock is not None and lock > LARGEST_LOCK:
        yield (
            f"[steering] rad_per_us {scale:g} turns the wheels by {lock:.0f} deg at 500 us; "
            "degrees per us? give radians per us"
        )
    elif lock is not None and lock < SMALLEST_LOCK:
        yield (
            f"[steering] rad_per_us {scale:g} turns the wheels by only {lock:.2g} deg at 500 us; "
            "rovers have 15..45 deg, which is 0.0005..0.0016 rad/us"
        )
    for key, (largest, slip) in LARGEST_OF_STEERING.items():
        unit, value = KEYS[f"steering.{key}"].unit, v.get(key, 0.0)
        if abs(value) > largest:
            yield f"[steering] {key} is {value:g}, above {largest:g} {unit}; {slip}"
        elif value < 0 and key not in EITHER_SIGN:
            yield f"[steering] {key} is {value:g} {unit}; it cannot be below 0"
