"""Drives a simulated rover with the steering and speed of recordings, and records it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path

from rover_sweep.comparison.corrected import Correction
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.errors import UsageError
from rover_sweep.logs.read import read_logs, runs_of
from rover_sweep.logs.readers.implausible import screened
from rover_sweep.redrive.recorded_course import course_of
from rover_sweep.redrive.vehicle_variant import as_measured, on_the_clock, refuse_instant
from sitl.plant.variant import PlantParameters
from sitl.redrive.open_loop import redrive

MEASURED = "measured, in the vehicle file"
Say = Callable[[str], None]


def with_measured(rover: PlantParameters, vehicle: Vehicle) -> tuple[PlantParameters, tuple[Correction, ...]]:
    """(the rover with the numbers of a vehicle file, what that changed)."""
    new = as_measured(rover, vehicle)
    changed = (f.name for f in fields(new) if getattr(rover, f.name) != getattr(new, f.name))
    return new, tuple(
        Correction(
            name, _text(getattr(rover, name)), _text(getattr(new, name)), _text(getattr(new, name)), MEASURED
        )
        for name in changed
    )


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_text(part) for part in value) + "]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def simulated_drives(
    sources: Sequence[str],
    rover: PlantParameters,
    folder: Path,
    simulator: str = "plant",
    ardurover: Path | None = None,
    seed: int = 1,
    say: Say = lambda words: None,
) -> tuple[str, ...]:
    """Paths of the recordings of a rover that repeats each log, on the clock of that log.

    simulator: "plant", "embedded" or "ardurover". UsageError where the rover overturns, DataRefused where a
    log has no steering, LinkError where the simulated rover does not drive it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return tuple(_all(sources, rover, folder, simulator, ardurover, seed, say))


def _all(
    sources: Sequence[str],
    rover: PlantParameters,
    folder: Path,
    simulator: str,
    ardurover: Path | None,
    seed: int,
    say: Say,
) -> Iterator[str]:
    number = 0
    for source in sources:
        for log in read_logs(source):
            number += 1
            target = folder / f"sim{number}.BIN"
            course = course_of(screened(log))
            if simulator == "plant":
                try:
                    redrive(course, on_the_clock(rover, runs_of(log)), target, seed + number)
                except ValueError as error:  # the rover overturns
                    raise UsageError(str(error)) from error
            else:
                refuse_instant(rover, simulator)
                from rover_sweep.redrive.on_autopilot import drive_course

                for words in drive_course(
                    course, replace(rover), target, simulator, ardurover, seed + number
                ):
                    say(f"{Path(source).name}: {words}")
            yield str(target)
