"""Plausible ranges of a rover's numbers, free of scale: for a vehicle file, and for results against it.

A value outside is not impossible, but an error is more likely: a wrong unit, a mistyped digit, or a model
that bends its numbers to imitate physics that it lacks. The ranges hold, with a margin of about 2, the
vehicles of `tests/data` (DART of 1.6 kg to Stanford's P1 of 1.7 t: radius of gyration over wheelbase .32 to
.45 in yaw and .18 to .23 in roll, 4 to 11 deg of roll per g) and the tyres of road cars (Gillespie,
Fundamentals of Vehicle Dynamics, 1992, pp. 347-355: cornering stiffness of 8 to 30 % of the load per deg,
which is 4.6 to 17 per rad). Tyres of small rovers have 2 to 4 per rad, and half of that on loose ground.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from rover_sweep.data.geometry import GRAVITY, Geometry

Numbers = Mapping[str, float]  # {name as in the models, such as "Izz": SI value}
NOTHING: Numbers = MappingProxyType({})


@dataclass(frozen=True)
class PlausibleRange:
    """A ratio of `names`, from low to high, in `unit`. words: the ratio, before "is 0.5 unit"."""

    words: str
    names: tuple[str, ...]
    ratio: Callable[[Numbers], float]
    low: float
    high: float
    unit: str = ""


def _roll_per_g(n: Numbers) -> float:
    """Steady roll angle [deg] per g of lateral acceleration; infinite for a rover that falls over."""
    excess = n["k_phi"] / (n["ms"] * GRAVITY * n["h"]) - 1.0
    return math.degrees(1.0 / excess) if excess > 0 else math.inf


YAW_GYRATION, ROLL_GYRATION = (0.2, 0.75), (0.08, 0.4)  # radius over the wheelbase
RANGES = (
    PlausibleRange(
        "mass / wheelbase^3",
        ("m", "a", "b"),
        lambda n: n["m"] / (n["a"] + n["b"]) ** 3,
        5.0,
        1500.0,
        "kg/m^3",
    ),
    PlausibleRange("sprung mass / mass", ("ms", "m"), lambda n: n["ms"] / n["m"], 0.4, 1.0),
    PlausibleRange(
        "CG to front axle / wheelbase", ("a", "b"), lambda n: n["a"] / (n["a"] + n["b"]), 0.15, 0.85
    ),
    PlausibleRange(
        "height of the CG above the roll centre / wheelbase",
        ("h", "a", "b"),
        lambda n: n["h"] / (n["a"] + n["b"]),
        -0.1,
        0.6,
    ),
    PlausibleRange(
        "radius of gyration in yaw / wheelbase",
        ("Izz", "m", "a", "b"),
        lambda n: math.sqrt(n["Izz"] / n["m"]) / (n["a"] + n["b"]),
        *YAW_GYRATION,
    ),
    PlausibleRange(
        "radius of gyration in roll / wheelbase",
        ("Ixx", "ms", "a", "b"),
        lambda n: math.sqrt(n["Ixx"] / n["ms"]) / (n["a"] + n["b"]),
        *ROLL_GYRATION,
    ),
    PlausibleRange("roll inertia / yaw inertia", ("Ixx", "Izz"), lambda n: n["Ixx"] / n["Izz"], 0.03, 0.9),
    PlausibleRange(
        "cornering stiffness of the front axle / its load",
        ("Cf", "m", "a", "b"),
        lambda n: n["Cf"] * (n["a"] + n["b"]) / (n["m"] * GRAVITY * n["b"]),
        0.8,
        40.0,
        "per rad",
    ),
    PlausibleRange(
        "cornering stiffness of the rear axle / its load",
        ("Cr", "m", "a", "b"),
        lambda n: n["Cr"] * (n["a"] + n["b"]) / (n["m"] * GRAVITY * n["a"]),
        0.8,
        40.0,
        "per rad",
    ),
    PlausibleRange(
        "cornering stiffness over load, front axle over rear axle",
        ("Cf", "Cr", "a", "b"),
        lambda n: n["Cf"] * n["a"] / (n["Cr"] * n["b"]),
        0.4,
        2.5,
    ),
    PlausibleRange("roll per lateral acceleration", ("k_phi", "ms", "h"), _roll_per_g, 0.2, 40.0, "deg/g"),
)
# Of an identified value over that of the vehicle file. In the paper models are within 25 % of the swing test.
OVER_FILE = {"Izz": (0.6, 1.7), "Ixx": (0.6, 1.7), "h": (0.6, 1.7), "ms": (0.8, 1.25), "m": (0.8, 1.25)}
STEERING_SCALE = (0.7, 1.4)  # true angle over that by rad_per_us
FILE_KEYS = {  # name as in the models: key of the vehicle file
    "m": "mass",
    "a": "cg_to_front_axle",
    "b": "cg_to_rear_axle",
    "ms": "sprung_mass",
    "h": "cg_height_above_roll_centre",
    "Ixx": "roll_inertia",
    "Izz": "yaw_inertia",
    "Ixz": "roll_yaw_inertia",
}
UNITS = {"Izz": " kg m^2", "Ixx": " kg m^2", "Cf": " N/rad", "Cr": " N/rad", "C": " N/rad", "h": " m"}
UNITS |= {"ms": " kg", "m": " kg", "k_phi": " N m/rad"}


def implausible(rover: Geometry, found: Numbers = NOTHING) -> tuple[str, ...]:
    """Sentences on numbers that are probably wrong; empty if all are plausible.

    rover: the numbers of the vehicle file; if they are implausible, only their sentence is returned, because
    results then differ from them anyway. found: {name: SI value} of an
    identification or a diagnosis, judged alone and against the file: "C" or "Cf" and "Cr" [N/rad of an axle],
    "Izz", "Ixx" [kg m^2], "h" [m], "k_phi" [N m/rad], and "steering_scale" [-], the true road-wheel angle
    over that by rad_per_us. Other names, and values that are nan, are ignored.
    """
    known = _of_file(rover)
    outside = [r for r in RANGES if _is_outside(r, known)]
    if not outside:
        return _implausible_result(known, found)
    concerned = [set(r.names) for r in outside]
    suspects = set.intersection(*concerned) or set.union(*concerned)
    suspects = suspects - {"a", "b"} or suspects
    keys = " or ".join(key for name, key in FILE_KEYS.items() if name in suspects)
    return (
        f"the vehicle file is implausible: {'; '.join(_ratio_words(r, known) for r in outside)}. "
        f"Check {keys} first: an error there makes every result wrong",
    )


def _implausible_result(known: Numbers, found: Numbers) -> tuple[str, ...]:
    """A sentence on each identified value outside its range, or far from the vehicle file's."""
    values = {name: value for name, value in found.items() if math.isfinite(value)}
    axles = dict.fromkeys(("Cf", "Cr"), values["C"]) if "C" in values else {}
    both = {**known, **axles, **values}
    out: dict[str, str] = {}
    for name, value in values.items():
        same = {"C": ("Cf", "Cr")}.get(name, (name,))
        new = [r for r in RANGES if {*same} & {*r.names} and not out.keys() & {*r.names}]
        against = [_ratio_words(r, both) for r in new if _is_outside(r, both)]
        low, high = OVER_FILE.get(name, (0.0, math.inf))
        if name in known and not low <= value / known[name] <= high:
            times = f"it is {value / known[name]:.3g} times the {known[name]:.3g}{UNITS[name]} of the vehicle"
            against.insert(0, f"{times} file (plausible: {low:g} to {high:g})")
        if against:
            out[name] = f"{name} = {value:.3g}{UNITS.get(name, '')} is implausible: {against[0]}"
    low, high = STEERING_SCALE
    if not low <= (scale := values.get("steering_scale", 1.0)) <= high:
        out["steering_scale"] = (
            f"a steering scale of {scale:.2g} times rad_per_us is implausible (plausible: {low:g} to "
            f"{high:g}); measure the angle of a wheel on blocks (bench)"
        )
    return tuple(out.values())


def _of_file(rover: Geometry) -> dict[str, float]:
    """{name: value} of the numbers that the file has."""
    all_numbers = {
        "m": rover.mass,
        "a": rover.a,
        "b": rover.b,
        "ms": rover.sprung_mass,
        "h": rover.h,
        "Ixx": rover.roll_inertia,
        "Izz": rover.yaw_inertia,
    }
    return {name: float(value) for name, value in all_numbers.items() if value}


def _is_outside(one: PlausibleRange, known: Numbers) -> bool:
    return all(n in known for n in one.names) and not one.low <= one.ratio(known) <= one.high


def _ratio_words(one: PlausibleRange, known: Numbers) -> str:
    unit = f" {one.unit}" if one.unit else ""
    return f"{one.words} is {one.ratio(known):.2g}{unit} (plausible: {one.low:g} to {one.high:g})"
