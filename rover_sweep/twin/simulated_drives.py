"""Drives a simulated rover with the steering and speed of recordings, and records it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from rover_sweep.comparison.corrected import Correction
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.errors import UsageError
from rover_sweep.logs.read import read_logs, runs_of
from rover_sweep.logs.readers.implausible import screened
from rover_sweep.redrive.grown_rover import as_measured_size, grown
from rover_sweep.redrive.recorded_course import course_of
from rover_sweep.redrive.vehicle_variant import as_measured, on_the_clock, refuse_instant
from sitl.plant.variant import PlantParameters
from sitl.redrive.course import Course
from sitl.redrive.open_loop import redrive

MEASURED = "measured, in the vehicle file"
GROWN = "of the nominal rover, scaled by the mass and size of the vehicle file"
LONG_AGO = 60.0  # s
Say = Callable[[str], None]
Columns = Mapping[str, Any] | str | None


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


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """One log to repeat. name: of its source; runs: found in it."""

    name: str
    course: Course
    runs: tuple[Recording, ...]


def recorded_drives(sources: Sequence[str], columns: Columns = None) -> tuple[RecordedDrive, ...]:
    """The drives in all logs. columns: the map of a .csv.

    UsageError where a source is no log, DataRefused where one has no steering output, gyro or speed.
    """
    for source in sources:
        if Path(source).is_dir():
            raise UsageError(
                f"{source} is a folder; give the .BIN or .tlog in it whose drive is to be repeated"
            )
    logs = [(source, log) for source in sources for log in read_logs(source, column_map=columns)]
    return tuple(RecordedDrive(Path(s).name, course_of(screened(log)), runs_of(log)) for s, log in logs)


def simulated_drives(
    drives: Sequence[RecordedDrive],
    rover: PlantParameters,
    folder: Path,
    simulator: str = "plant",
    ardurover: Path | None = None,
    seed: int = 1,
    say: Say = lambda words: None,
) -> tuple[str, ...]:
    """Paths of the recordings of a rover that repeats each drive, on the clock of its log.

    simulator: "plant", "embedded" or "ardurover". UsageError where the rover overturns, LinkError where the
    simulated rover does not drive it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if simulator == "plant":
        return tuple(_by_plant(drives, rover, folder, seed))
    from rover_sweep.redrive.on_autopilot import drive_course

    refuse_instant(rover, simulator)
    targets = []
    for k, drive in enumerate(drives):
        targets.append(folder / f"sim{k + 1}.BIN")
        for words in drive_course(drive.course, rover, targets[k], simulator, ardurover, seed + k):
            say(f"{drive.name}: {words}")
    return tuple(map(str, targets))


def _by_plant(
    drives: Sequence[RecordedDrive], rover: PlantParameters, folder: Path, seed: int
) -> Iterator[str]:
    changed = False  # the ground, in a drive before
    for k, drive in enumerate(drives):
        target = folder / f"sim{k + 1}.BIN"
        here = on_the_clock(rover, drive.runs)
        here = _changed_before(rover, float(drive.course.t[0])) if changed else here
        changed |= rover.effects.get("surface_change", {}).get("run") in [run.name for run in drive.runs]
        try:
            redrive(drive.course, here, target, seed + k)
        except ValueError as error:  # the rover overturns
            raise UsageError(str(error)) from error
        yield str(target)


def _changed_before(rover: PlantParameters, start: float) -> PlantParameters:
    """The rover on ground that changed in a log before this one; start: of this one's course [s]."""
    change = {**rover.effects["surface_change"], "t": start - LONG_AGO}
    return replace(rover, effects={**rover.effects, "surface_change": change})
