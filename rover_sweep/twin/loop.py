"""The loop of a twin: drive the simulation, compare, correct, until it agrees or nothing helps."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from math import log, sqrt
from pathlib import Path
from typing import Any

from rover_sweep.comparison.answer import Comparison, Correction, Twin, TwinDrive
from rover_sweep.comparison.compare import Compared
from rover_sweep.comparison.differences import Known
from rover_sweep.comparison.direct import bode_of_runs, driven_again, histories_of
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_geometry import geometry_of, tolerances_of
from rover_sweep.diagnosis.effects import form_named, library
from rover_sweep.diagnosis.effects.effect import SpeedEffect
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.errors import RoverSweepError, UsageError
from rover_sweep.logs.read import read_logs, runs_of
from rover_sweep.logs.readers.screening import screened
from rover_sweep.redrive.recorded_course import (
    as_measured,
    as_measured_size,
    course_of,
    grown,
    on_the_clock,
    refuse_instant,
)
from rover_sweep.twin.correct import NOT_IN_THE_PLANT, Corrected, corrected, halved, number_text
from sitl.plant.effects_table import FORMS
from sitl.plant.variant import PlantParameters, load_variant, unit_of
from sitl.plant.variant_text import law_text, value_text
from sitl.redrive.course import Course
from sitl.redrive.open_loop import redrive

# Drives a simulated rover with the steering and speed of recordings, and records it.


MEASURED = "measured, in the vehicle file"
GROWN = "of the nominal rover, scaled by the mass and size of the vehicle file"
LONG_AGO = 60.0  # s
BY_MASS = {
    "front_cornering_stiffness",
    "rear_cornering_stiffness",
    "yaw_inertia",
    "roll_inertia",
    "roll_stiffness",
    "roll_damping",
}
RATIOS = (
    "driving shows stiffness, inertia, spring and damping only relative to the mass: with a wrong mass in "
    "the vehicle file, simulation and recordings still agree, but all these numbers are wrong by that share"
)

Columns = Mapping[str, Any] | str | None


def with_measured(rover: PlantParameters, vehicle: Vehicle) -> tuple[PlantParameters, tuple[Correction, ...]]:
    """(the rover with the numbers of a vehicle file, the changes); other numbers scale with size."""
    scaled = grown(rover, as_measured_size(rover, vehicle))
    new = as_measured(scaled, vehicle)
    changed = [f.name for f in fields(new) if getattr(rover, f.name) != getattr(new, f.name)]
    entries = []
    for name in changed:
        before, after = number_text(getattr(rover, name)), number_text(getattr(new, name))
        in_file = getattr(vehicle, name, None) is not None or getattr(scaled, name) != getattr(new, name)
        shown, reason = (after, MEASURED) if in_file else ("", GROWN)
        entries.append(Correction(name, before, after, shown, reason, unit_of(name)))
    return new, tuple(entries)


def measured_differences(vehicle: Vehicle, rover: PlantParameters) -> Known:
    """{coordinate: (the vehicle file's value minus the simulated rover's, standard deviation)}.

    So no correction moves a number by more than its measurement allows.
    """
    own, spread = geometry_of(vehicle), tolerances_of(vehicle)
    ahead, _, down = rover.imu_position
    above = rover.cg_height_above_roll_centre - down
    out = {
        "da": (own.a - rover.cg_to_front_axle, spread.cg * own.wheelbase),
        "imu_x": (own.imu_x - ahead, spread.imu_x * own.wheelbase),
        "imu_z": (own.imu_z - above, spread.imu_z * own.wheelbase),
    }
    if vehicle.rad_per_us is not None:
        out["scale"] = (1.0 - rover.rad_per_us / vehicle.rad_per_us.value, spread.scale)
    if own.h:
        out["ln_h"] = (log(own.h / rover.cg_height_above_roll_centre), spread.h)
    if own.roll_inertia:
        out["ln_Ixx"] = (log(own.roll_inertia / rover.roll_inertia), spread.roll_inertia)
    return out


@dataclass(frozen=True, eq=False)
class RecordedDrive:
    """One log to repeat. name: of its source; runs: found in it."""

    name: str
    course: Course
    runs: tuple[Recording, ...]


def recorded_drives(sources: Sequence[str], columns: Columns = None) -> tuple[RecordedDrive, ...]:
    """The drives in all logs. columns: the map of a .csv.

    UsageError if a source is no log, DataRefused if one has no steering output, gyro or speed.
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

    simulator: "plant", "embedded" or "ardurover". UsageError if the rover overturns, LinkError if the
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
        if changed:  # in a log before this one
            change = {**rover.effects["surface_change"], "t": float(drive.course.t[0]) - LONG_AGO}
            here = replace(rover, effects={**rover.effects, "surface_change": change})
        changed |= rover.effects.get("surface_change", {}).get("run") in [run.name for run in drive.runs]
        try:
            redrive(drive.course, here, target, seed + k)
        except ValueError as error:  # the rover overturns
            raise UsageError(str(error)) from error
        yield str(target)


# The corrected rover as a variant file: every line with its reason.


TABLES = ("effects", "laws")


def variant_with_reasons(rover: PlantParameters, corrections: Sequence[Correction], origin: str) -> str:
    """The variant as TOML text. origin: the uncorrected rover, in words."""
    nominal = load_variant("nominal")
    reasons = {
        c.entry: [f"# was {c.before or 'not there'}: {' '.join(c.reason.split())}"] for c in corrections
    }
    lines = [
        f"# The simulated rover {origin}, corrected by rover-sweep until it agreed with recordings.",
        "# Numbers that are not here are those of the nominal rover.",
        'base = "nominal"',
        "",
    ]
    for f in fields(rover):
        value = getattr(rover, f.name)
        if f.name not in TABLES and value != getattr(nominal, f.name):
            lines += [*reasons.get(f.name, ()), f"{f.name} = {value_text(_rounded(value))}"]
    lines += ["", "[effects]"]
    for name, entry in rover.effects.items():
        values = ", ".join(f"{p} = {value_text(_rounded(v))}" for p, v in entry.items())
        lines += [*reasons.get(f"effects.{name}", ()), f"{name} = {{ {values} }}"]
    return "\n".join([*lines, "", *(law_text(law) for law in rover.laws)])


def _rounded(value: object) -> object:
    if isinstance(value, tuple):
        return tuple(_rounded(part) for part in value)
    return float(f"{value:.7g}") if isinstance(value, float) else value


MOST_DRIVES = 5
MOST_IN_VAIN = 2  # drives in a row that do not help: with a correction, and with half of it
HELPED = 0.98  # of the level before, below which a correction helped
SETTLED = 1.0  # level at which small differences are left alone

Drive = Callable[[PlantParameters], Sequence[Recording]]
Compare = Callable[[Sequence[Recording], tuple[str, ...], PlantParameters, Collection[str]], Compared]
Say = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class _Driven:
    """One drive: the rover, the corrections before it, and its comparison."""

    rover: PlantParameters
    by: Corrected
    compared: Compared

    @property
    def answer(self) -> Comparison:
        """The comparison as a user gets it."""
        return self.compared.answer

    @property
    def level(self) -> float:
        """RMS over the noise of the runs that were used."""
        used = [a.overall for a in self.answer.agreement if not a.held_out]
        return sqrt(sum(x * x for x in used) / len(used))


def twin_of(
    rover: PlantParameters,
    measured: Sequence[Correction],
    model: AugmentedModel,
    drive: Drive,
    compare: Compare,
    say: Say = lambda words: None,
    stop: Callable[[], bool] = lambda: False,
) -> tuple[Twin, PlantParameters]:
    """(the twin, its rover). Held-out runs do not decide what is corrected or kept.

    A correction that does not help, or with which the rover cannot be driven, is halved first.

    rover: the first one; measured: its entries that a vehicle file replaced. model: of the recordings.
    drive(rover) -> its recordings with the steering of all recorded runs; compare(recordings, names of the
    laws that the simulation has, the rover, quantities that were corrected before).
    """
    started = time.monotonic()
    driven = [_Driven(rover, Corrected(rover, (), ()), _compared(rover, model, drive, compare))]
    say(_progress(driven))
    remarks: list[str] = []
    in_vain = 0
    while len(driven) < MOST_DRIVES and not stop():
        last, best = driven[-1], min(driven, key=lambda d: d.level)
        if last is best and not _to_correct(last.answer):
            break
        by = corrected(last.rover, last.answer, model) if last is best else halved(best.rover, last.by)
        if not by.corrections:
            break
        changed = {d.name for one in driven for d in (*one.answer.differences, *one.answer.minor)}
        try:
            next_drive = partial(_compared, model=model, drive=drive, compare=compare, changed=changed)
            try:
                again = _Driven(by.parameters, by, next_drive(by.parameters))
            except RoverSweepError:  # it cannot be driven with the whole corrections
                half = halved(last.rover, by)
                again = _Driven(half.parameters, half, next_drive(half.parameters))
        except RoverSweepError as error:  # it overturns, or its run is too short to be compared
            remarks.append(f"the rover could not be driven with the next corrections: {error}")
            break
        driven.append(again)
        say(_progress(driven))
        helped = again.level < HELPED * best.level or again.level < SETTLED
        in_vain = 0 if helped else in_vain + 1
        if in_vain == MOST_IN_VAIN:
            break
    best = min(driven, key=lambda d: d.level)
    if best is not driven[-1]:
        number = driven.index(best) + 1
        remarks.append(f"the corrections after drive {number} did not help, so they were taken back")
    kept = driven[: driven.index(best) + 1]
    left = corrected(best.rover, best.answer, model).left
    now = corrected(best.rover, replace(best.answer, differences=best.compared.left, minor=()), model)
    recorded = {c.entry: c.recordings for c in now.corrections}
    seconds = time.monotonic() - started
    return _twin(driven, kept, measured, recorded, left, tuple(remarks), seconds), best.rover


def with_last_drive(
    twin: Twin, rover: PlantParameters, model: AugmentedModel, drive: Drive, compare: Compare, simulator: str
) -> Twin:
    """The twin with one more drive of its rover on another simulator, which decides whether it agrees.

    If that drive fails or cannot be compared, a remark says why.
    """
    try:
        last = _compared(rover, model, drive, compare).answer
    except RoverSweepError as error:
        return replace(twin, remarks=(*twin.remarks, f"the drive on {simulator} does not count: {error}"))
    agrees = all(a.agrees for a in last.agreement)
    words = _sentence(agrees, last, len(twin.corrections), len(twin.rounds) + 1)
    rounds = (*twin.rounds, TwinDrive(last, (), simulator))
    return replace(twin, sentence=f"driven on {simulator}: {words}", agrees=agrees, rounds=rounds)


def _to_correct(found: Comparison) -> bool:
    """True if a correctable difference matters, or runs still differ because of small ones."""
    if any(d.name not in NOT_IN_THE_PLANT for d in found.differences):
        return True
    return bool(found.minor) and any(not a.agrees for a in found.agreement if not a.held_out)


def _compared(
    rover: PlantParameters,
    model: AugmentedModel,
    drive: Drive,
    compare: Compare,
    changed: Collection[str] = (),
) -> Compared:
    return compare(drive(rover), laws_of(rover, model), rover, changed)


def laws_of(rover: PlantParameters, model: AugmentedModel) -> tuple[str, ...]:
    """Names of the laws of a simulated rover, without those that act on the speed alone.

    A change of ground counts only if the recordings' model has it, with its run.
    """
    known = library()
    own = {form_named(name).id for name in model.effects}
    return tuple(
        _law(name, entry)
        for name, entry in rover.effects.items()
        if name in known
        and not isinstance(known[name], SpeedEffect)
        and (name in own or not known[name].in_one_run)
    )


def _law(name: str, entry: Mapping[str, float | str]) -> str:
    form = entry.get("form")
    return name if form is None or form == FORMS.get(name, (form,))[0] else f"{name}/{form}"


def _progress(driven: Sequence[_Driven]) -> str:
    last = driven[-1]
    worst = max((a.overall for a in last.answer.agreement), default=0.0)
    return f"drive {len(driven)}: the difference of a run is at most {worst:.2g} times the noise of both"


def _twin(
    driven: Sequence[_Driven],
    kept: Sequence[_Driven],
    measured: Sequence[Correction],
    recorded: Mapping[str, str],
    left: tuple[str, ...],
    remarks: tuple[str, ...],
    seconds: float,
) -> Twin:
    first, last = driven[0].compared, kept[-1].compared
    agrees = all(a.agrees for a in last.answer.agreement)
    after = [*driven[1:], None]
    rounds = tuple(
        TwinDrive(d.compared.answer, n.by.corrections if n else ())
        for d, n in zip(driven, after, strict=True)
    )
    shown = [
        *(driven_again(first.unused, last.unused, True) if first.unused and last.unused else ()),
        *driven_again(first.used, last.used, False),
    ]
    corrections = tuple(
        replace(c, recordings=recorded.get(c.entry, c.recordings))
        for c in together([measured, *(d.by.corrections for d in kept)])
    )
    return Twin(
        _sentence(agrees, last.answer, len(corrections), len(driven)),
        agrees,
        rounds,
        corrections,
        left,
        histories_of(shown),
        bode_of_runs(shown),
        (*remarks, *((RATIOS,) if BY_MASS & {c.entry for c in corrections} else ())),
        seconds=seconds,
    )


def _sentence(agrees: bool, last: Comparison, changed: int, drives: int) -> str:
    held = [a.overall for a in last.agreement if a.held_out]
    worst = max(held or [a.overall for a in last.agreement])
    where = "on the held-out runs" if held else "on the runs that were used; no run was held out"
    size = f"their difference is {worst:.2f} times the noise of both {where}"
    if agrees and not changed:
        return f"the simulation agreed with the recordings as it was: {size}"
    if agrees:
        many = f"{changed} correction{'s' if changed > 1 else ''}"
        return f"after {many} the simulation agrees with the recordings: {size}"
    many = f"{drives} drive{'s' if drives > 1 else ''}"
    return f"the simulation still differs from the recordings after {many}: {size}"


def together(parts: Sequence[Sequence[Correction]]) -> tuple[Correction, ...]:
    """All corrections of an entry as one, from its first value to its last."""
    out: dict[str, Correction] = {}
    for c in (c for part in parts for c in part):
        if first := out.get(c.entry):
            # the first difference is the largest; a measured number has the reason of its correction
            reason = c.reason if first.reason == MEASURED else first.reason
            c = replace(c, before=first.before, reason=reason)
        out[c.entry] = c
    return tuple(c for c in out.values() if c.before != c.after)
