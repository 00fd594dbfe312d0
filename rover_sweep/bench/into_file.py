"""What a bench found, into the vehicle file: which numbers, and with which uncertainty."""

from __future__ import annotations

from math import hypot
from pathlib import Path

from rover_sweep.bench.result import BenchResult, Number
from rover_sweep.inertia import rounded
from rover_sweep.vehicle_file import Measured, set_numbers
from rover_sweep.vehicle_rules import KEYS

LEAST_SURE = 0.1  # of rad_per_us, as a standard deviation


def slope_of(result: BenchResult) -> Number | None:
    """rad_per_us: the mean slope, or that at the centre where a curve that goes with it was found."""
    bent = [result.get(name) for name in ("nonlinearity", "deadband")]
    found = any(n is not None and (n.low > 0 or n.high < 0) for n in bent)
    centre = result.get("centre")
    return centre if found and centre is not None else result.get("rad_per_us")


def numbers_for_file(result: BenchResult) -> dict[str, Measured]:
    """{key of the vehicle file: number}; without what was not told, or a slope hardly known."""
    out = {}
    slope = slope_of(result)
    if slope is not None and slope.told and slope.sd < LEAST_SURE * abs(slope.value):
        out["steering.rad_per_us"] = rounded(Measured(slope.value, slope.sd))
    for number in result.numbers:
        if number.key in KEYS and number.told:
            out[number.key] = rounded(_worth(number))
    return out


def _worth(number: Number) -> Measured:
    """The number, or 0 where its interval holds 0, with what it might be as the uncertainty: whoever reads
    the file uses what stands there, and must not bend the steering by noise."""
    if number.low <= 0.0 <= number.high:
        return Measured(0.0, hypot(number.value, number.sd))
    return Measured(number.value, number.sd)


def write(path: Path, result: BenchResult) -> dict[str, Measured]:
    """Write them into the file, comments kept; what was written."""
    numbers = numbers_for_file(result)
    set_numbers(path, numbers)
    return numbers
