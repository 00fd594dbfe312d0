"""The files of a bench: bench.json, bench.tlog, readings.csv, and wheel.csv or wheel.tlog.

All data are on disk before they are used, so that an interrupted bench can be evaluated.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

from rover_sweep.bench.steering_output import CHANNELS
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.files.documents import read_json
from rover_sweep.vehicle.link.recorder import writing

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
