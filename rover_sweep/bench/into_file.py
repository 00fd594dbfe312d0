"""What a bench found, into the vehicle file: which numbers, and with which uncertainty."""

from __future__ import annotations

from math import hypot
from pathlib import Path

from rover_sweep.bench.bench_result import BenchResult, Number
from rover_sweep.bench.swing_test import rounded
from rover_sweep.data.vehicle_file import Measured, set_numbers
from rover_sweep.data.vehicle_rules import KEYS

LEAST_SURE = 0.1  # of rad_per_us, as a standard deviation
CURVE = ("nonlinearity", "deadband")


def bent(result: BenchResult) -> bool:
    """Whether a curve or a band was found: they go with the slope at the centre, else the mean one counts."""
    found = (result.get(name) for name in CURVE)
    return result.get("centre") is not None and any(n is not None and not _holds_0(n) for n in found)


def slope_of(result: BenchResult) -> Number | None:
    """rad_per_us: the mean slope, or that at the centre where a curve that goes with it was found."""
    return result.get("centre" if bent(result) else "rad_per_us")


def numbers_for_file(result: BenchResult) -> dict[str, Measured]:
    """{key of the vehicle file: number}; without what was not told, or a slope hardly known.

    Whoever reads the file uses what stands there, and must not bend the steering by noise: 0 stands where
    the interval holds 0, with what it might be as the uncertainty. Curve, band and centre were fitted to the
    same angles: they are taken or left together.
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
