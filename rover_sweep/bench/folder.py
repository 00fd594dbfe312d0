"""What lies in a bench's folder: bench.json, bench.tlog, readings.csv, and wheel.csv or wheel.tlog.

All is on disk before it is looked at, so that a bench that was broken off can be evaluated as far as it came.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.vehicle.recorder import writing

FORMAT = "rover-sweep bench 1"
DESCRIPTION, TELEMETRY, READINGS = "bench.json", "bench.tlog", "readings.csv"
WHEEL_CSV, WHEEL_TLOG = "wheel.csv", "wheel.tlog"
_HEADER = ("t_s", "movement", "offset_us", "pwm_us", "angle_rad", "typed")


@dataclass(frozen=True)
class Reading:
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
        """bench.json, whole or not at all."""
        target = self.path / DESCRIPTION
        part = target.with_suffix(".json.part")
        with writing(target):
            part.write_text(json.dumps({"format": FORMAT, **content}, indent=2, default=str) + "\n")
            part.replace(target)

    def add(self, reading: Reading) -> None:
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
        """What bench.json says. UsageError where there is none, DataRefused where it is not one."""
        target = self.path / DESCRIPTION
        try:
            content = json.loads(target.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise UsageError(
                f"{self.path} is no folder of a bench: there is no {DESCRIPTION} in it"
            ) from None
        except (OSError, ValueError) as error:
            raise DataRefused(f"{target} cannot be read: {error}") from error
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise DataRefused(f"{target} is no {FORMAT!r}: it was written by another program or version")
        return content

    def readings(self) -> tuple[Reading, ...]:
        """The angles that were read; a last line that was cut off is left out."""
        target = self.path / READINGS
        if not target.is_file():
            return ()
        with target.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.reader(file) if len(row) == len(_HEADER)]
        try:
            return tuple(
                Reading(float(t), movement, float(offset), float(pwm), float(angle), typed)
                for t, movement, offset, pwm, angle, typed in rows[1:]
            )
        except ValueError as error:
            raise DataRefused(f"{target} is damaged: {error}") from error
