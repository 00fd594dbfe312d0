"""The files of a bench: bench.json, bench.tlog, readings.csv, and wheel.csv or wheel.tlog.

All data are on disk before they are used, so that an interrupted bench can be evaluated.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot, inf, isfinite, nan
from pathlib import Path
from typing import Any

from rover_sweep.bench.steering_output import CHANNELS
from rover_sweep.bench.swing_test import rounded
from rover_sweep.data.vehicle_file import Measured, set_numbers
from rover_sweep.data.vehicle_rules import KEYS
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.files.documents import read_json
from rover_sweep.vehicle.link.recorded_transport import writing

FORMAT = "rover-sweep bench 1"
DESCRIPTION, TELEMETRY, READINGS = "bench.json", "bench.tlog", "readings.csv"
WHEEL_CSV, WHEEL_TLOG = "wheel.csv", "wheel.tlog"
LEAST_TRIM, MOST_TRIM = 500, 2500  # us, of any servo
_HEADER = ("t_s", "movement", "offset_us", "pwm_us", "angle_rad", "typed")


@dataclass(frozen=True)
class AngleReading:
    """An angle read by hand. t: vehicle's clock [s]; offset asked for, pwm seen [us]; angle [rad], left
    positive, NaN where it was left out."""

    t: float
    movement: str
    offset: float
    pwm: float
    angle: float
    typed: str = ""


@dataclass(frozen=True)
class BenchFolder:
    """A folder of one bench."""

    path: Path

    def describe(self, content: Mapping[str, Any]) -> None:
        """Write bench.json, as a whole or not at all."""
        target = self.path / DESCRIPTION
        part = target.with_suffix(".json.part")
        with writing(target):
            part.write_text(json.dumps({"format": FORMAT, **content}, indent=2, default=str) + "\n")
            part.replace(target)

    def add(self, reading: AngleReading) -> None:
        """Append to readings.csv; on disk when this returns."""
        target = self.path / READINGS
        with writing(target), target.open("a", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            if file.tell() == 0:
                writer.writerow(_HEADER)
            r = reading
            writer.writerow((f"{r.t:.3f}", r.movement, f"{r.offset:g}", f"{r.pwm:g}", repr(r.angle), r.typed))
            file.flush()
            os.fsync(file.fileno())

    def description(self) -> dict[str, Any]:
        """The content of bench.json. UsageError if it is missing, DataRefused if it is damaged."""
        target = self.path / DESCRIPTION
        try:
            content = read_json(target.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise UsageError(f"{self.path} is not a bench's folder: it has no {DESCRIPTION}") from None
        except (OSError, ValueError) as error:
            raise DataRefused(f"{target} cannot be read: {error}") from error
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise DataRefused(f"{target} is not {FORMAT!r}: it was written by another program or version")
        if wrong := _wrong(content):
            raise DataRefused(f"{target} is damaged: {wrong}; correct it and evaluate again")
        return content

    def readings(self) -> tuple[AngleReading, ...]:
        """The angles that were read, without a truncated last line."""
        target = self.path / READINGS
        if not target.is_file():
            return ()
        try:
            with target.open(newline="", encoding="utf-8") as file:
                rows = [row for row in csv.reader(file) if len(row) == len(_HEADER)]
            return tuple(
                AngleReading(_finite(t), movement, _finite(offset), _finite(pwm), float(angle), typed)
                for t, movement, offset, pwm, angle, typed in rows[1:]
            )
        except OSError as error:
            raise DataRefused(f"{target} cannot be read: {error}") from error
        except (ValueError, csv.Error) as error:
            raise DataRefused(f"{target} is damaged: {error}; remove the line and evaluate again") from error


def _finite(text: str) -> float:
    if not isfinite(value := float(text)):
        raise ValueError(f"it has {text} as a time or PWM")
    return value


def _wrong(content: Mapping[str, Any]) -> str:
    """The first invalid value of those that are evaluated, in a phrase; "" if all are valid."""
    output, wheel = content.get("steering_output"), content.get("wheel")
    if not isinstance(output, dict):
        return f"steering_output is {output!r}, not an object with the servo and its trim"
    trim, servo = output.get("trim"), output.get("servo")
    if not isinstance(trim, int | float) or not LEAST_TRIM <= trim <= MOST_TRIM:
        return f"steering_output.trim is {trim!r}, not a PWM of {LEAST_TRIM} to {MOST_TRIM} us"
    if type(servo) is not int or servo not in CHANNELS:
        return f"steering_output.servo is {servo!r}, not an output from {CHANNELS[0]} to {CHANNELS[-1]}"
    if wheel is not None and not isinstance(wheel, dict):
        return f"wheel is {wheel!r}, neither null nor an object"
    if wheel and not isinstance(same := wheel.get("same_clock", False), bool):
        return f"wheel.same_clock is {same!r}, neither true nor false"
    return ""


# The result of a bench: numbers with intervals, and the reasons for missing ones.


@dataclass(frozen=True)
class Number:
    """A number with its standard deviation and interval. key: in the vehicle file, '' if it has none."""

    name: str
    unit: str
    value: float
    sd: float
    low: float
    high: float
    meaning: str
    key: str = ""

    @property
    def determined(self) -> bool:
        """Whether the data determine it (not, for example, a rate limit that no step reached)."""
        return isfinite(self.value) and isfinite(self.sd)

    def __str__(self) -> str:
        return f"{self.value:.4g} {self.unit} ({self.low:.4g} to {self.high:.4g})"


@dataclass(frozen=True)
class BenchResult:
    """untold: sentences on why numbers were not measured; remarks: sentences; residual: rms [rad]; samples:
    number of angles."""

    source: str
    numbers: tuple[Number, ...]
    untold: tuple[str, ...]
    remarks: tuple[str, ...]
    residual: float
    samples: int

    def get(self, name: str) -> Number | None:
        """A number by its name."""
        return next((number for number in self.numbers if number.name == name), None)


def interval(
    name: str,
    unit: str,
    value: float,
    sd: float,
    factor: float,
    meaning: str,
    key: str = "",
    least: float = -inf,
) -> Number:
    """The number value +- factor sd; least: lower bound of the value and of the interval."""
    value, sd = float(value), float(sd)  # plain, as files and JSON take them
    low, high = value - factor * sd, value + factor * sd
    return Number(name, unit, max(value, least), sd, max(low, least), max(high, least), meaning, key)


def rate_limit(slowness: float, sd: float, factor: float) -> Number:
    """The rate limit [rad/s] from its inverse [s/rad]; NaN with only a lower bound if no step reached it."""
    slowness, sd = float(slowness), float(sd)
    least, most = slowness - factor * sd, slowness + factor * sd
    meaning = "fastest rate of the road wheel"
    key = "steering.servo_rate_limit"
    if least <= 0:
        return Number("servo_rate_limit", "rad/s", nan, nan, 1.0 / max(most, 1e-6), inf, meaning, key)
    rate = 1.0 / slowness
    return Number("servo_rate_limit", "rad/s", rate, sd * rate**2, 1.0 / most, 1.0 / least, meaning, key)


# Writes the numbers of a bench, with their uncertainty, into the vehicle file.


LEAST_SURE = 0.1  # largest relative standard deviation of rad_per_us that is written
CURVE = ("nonlinearity", "deadband")


def bent(result: BenchResult) -> bool:
    """Whether a curve or a deadband was found: then the slope at the centre counts, else the mean slope."""
    found = (result.get(name) for name in CURVE)
    return result.get("centre") is not None and any(n is not None and not _holds_0(n) for n in found)


def numbers_for_file(result: BenchResult) -> dict[str, Measured]:
    """{key of the vehicle file: number}; without undetermined numbers and without an uncertain slope.

    The file must not contain noise as a property of the steering: a number whose interval includes 0 is
    written as 0, with its possible size as the uncertainty. Curve, deadband and slope at the centre were
    fitted to the same angles, so they are written together or not at all.
    """
    out, together = {}, CURVE if bent(result) else ()
    slope = result.get("centre" if bent(result) else "rad_per_us")
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
    """Write them into the file; keeps comments. Returns those written."""
    numbers = numbers_for_file(result)
    set_numbers(path, numbers)
    return numbers
