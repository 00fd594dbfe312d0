"""Writes the numbers of a bench, with their uncertainty, into the vehicle file."""

from __future__ import annotations

from math import hypot
from pathlib import Path

from rover_sweep.bench.bench_result import BenchResult, Number
from rover_sweep.bench.swing_test import rounded
from rover_sweep.data.vehicle_file import Measured, set_numbers
from rover_sweep.data.vehicle_rules import KEYS

LEAST_SURE = 0.1  # largest relative standard deviation of rad_per_us that is written
CURVE = ("nonlinearity", "deadband")


def bent(result: BenchResult) -> bool:
    """Whether a curve or a deadband was found: then the slope at the centre counts, else the mean slope."""
    found = (result.get(name) for name in CURVE)
    return result.get("centre") is not None and any(n is not None and not _holds_0(n) for n in found)


def slope_of(result: BenchResult) -> Number | None:
    """rad_per_us: the mean slope, or the slope at the centre if a curve was found."""
    return result.get("centre" if bent(result) else "rad_per_us")


def numbers_for_file(result: BenchResult) -> dict[str, Measured]:
    """{key of the vehicle file: number}; without undetermined numbers and without an uncertain slope.

    The file must not contain noise as a property of the steering: a number whose interval includes 0 is
    written as 0, with its possible size as the uncertainty. Curve, deadband and slope at the centre were
    fitted to the same angles, so they are written together or not at all.
    """
    out, together = {}, CURVE if bent(result) else ()
    slope = slope_of(result)
    if slope is not None and slope.determined and slope.sd < LEAST_SURE * abs(slope.value):
        out["steering.rad_per_us"] = rounded(Measured(slope.value, slope.sd))
    for number in result.numbers:
        if number.key in KEYS and number.determined:
            nothing = _holds_0(number) and number.name not in together
            value, sd = (0.0, hypot(number.value, number.sd)) if nothing else (number.value, number.sd)
            out[number.key] = rounded(Measured(value, sd))
    return out


def _holds_0(number: Number) -> bool:
    return number.low <= 0.0 <= number.high


def write_bench_numbers(path: Path, result: BenchResult) -> dict[str, Measured]:
    """Write them into the file, comments kept; what was written."""
    numbers = numbers_for_file(result)
    set_numbers(path, numbers)
    return numbers
