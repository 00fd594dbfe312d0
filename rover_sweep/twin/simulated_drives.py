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
from rover_sweep.redrive.grown_rover import as_measured_size, grown
from rover_sweep.redrive.recorded_course import course_of
from rover_sweep.redrive.vehicle_variant import as_measured, on_the_clock, refuse_instant
from sitl.plant.variant import PlantParameters
from sitl.redrive.open_loop import redrive

MEASURED = "measured, in the vehicle file"
GROWN = "of the nominal rover, scaled by the mass and size of the vehicle file"
LONG_AGO = 60.0  # s
Say = Callable[[str], None]


def with_measured(rover: PlantParameters, vehicle: Vehicle) -> tuple[PlantParameters, tuple[Correction, ...]]:
    """(the rover with the numbers of a vehicle file, what that changed); the rest grows with its size."""
    scaled = grown(rover, as_measured_size(rover, vehicle))
    new = as_measured(scaled, vehicle)
    changed = [f.name for f in fields(new) if getattr(rover, f.name) != getattr(new, f.name)]
    return new, tuple(_entry(name, rover, scaled, new, vehicle) for name in changed)


def _entry(
    name: str, rover: PlantParameters, scaled: PlantParameters, new: PlantParameters, vehicle: Vehicle
) -> Correction:
    before, after = _text(getattr(rover, name)), _text(getattr(new, name))
    in_file = getattr(vehicle, name, None) is not None or getattr(scaled, name) != getattr(new, name)
    return Correction(name, before, after, after if in_file else "", MEASURED if in_file else GROWN)


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
    number, changed = 0, False  # changed: the ground, in a log before
    for source in sources:
        for log in read_logs(source):
            number += 1
            target = folder / f"sim{number}.BIN"
            course = course_of(screened(log))
            if simulator == "plant":
                runs = runs_of(log)
                here = on_the_clock(rover, runs)
                here = _changed_before(rover, float(course.t[0])) if changed else here
                changed |= rover.effects.get("surface_change", {}).get("run") in [run.name for run in runs]
                try:
                    redrive(course, here, target, seed + number)
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


def _changed_before(rover: PlantParameters, start: float) -> PlantParameters:
    """The rover on ground that changed in a log before this one; start: of this one's course [s]."""
    change = {**rover.effects["surface_change"], "t": start - LONG_AGO}
    return replace(rover, effects={**rover.effects, "surface_change": change})
