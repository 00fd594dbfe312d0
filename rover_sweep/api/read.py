"""Reads runs from files: `rs.read`, and functions for the command line with several groups of files.

A source is a .BIN, a .tlog, a file of another system (`logs.readers.tables`), one trial of it as
"runs.csv:3", a pair "log.BIN+log.tlog", or the folder of a session.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.api.known_steering import through_linkage
from rover_sweep.data.recording import (
    Note,
    Recording,
    grouped_warnings,
    joined_frames,
    named,
    source_names,
    steered,
)
from rover_sweep.data.results import ShortTable, Shown, plain_number
from rover_sweep.data.vehicle_file import MODELS, Vehicle
from rover_sweep.data.vehicle_file import load as load_vehicle
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.identification.toml_form import StructureError, structure_from_text
from rover_sweep.logs.read import READ, existing_log, read_runs
from rover_sweep.quality.faults import each_with_length, is_unexcited
from rover_sweep.quality.rovers import stopped_at, with_rovers
from rover_sweep.quality.verdict import CoherenceTable, assess
from rover_sweep.session.folder import is_session, kept_vehicle_file, without_run
from rover_sweep.session.session import session_runs

Location = str | PathLike[str]

LEFT_OUT = (
    "is not fitted: a sweep about a steering offset shows the rover near a steady turn, and the other "
    "runs show it near straight driving; identify it alone, or use it in diagnose"
)


_BLOCK = 64  # samples of a run that no other run has
_ROUNDED = 1e-3  # a copy's rounding over the standard deviation of the yaw rate
_GRID, _SAME_DRIVE = 50.0, 0.95  # Hz; correlation of two logs of one drive, without a shift in time


def divided(runs: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """(runs to fit, doublets to verify on); DataRefused where no run can be fitted.

    A linear model is valid about one operating point, so sweeps about a steering offset are left out when
    there are straight runs; the first of these gets a note.
    """
    refuse_without_sweep(runs)
    others, doublets = doublets_apart(runs)
    biased = [run.name for run in others if run.kind == "bias_sweep"]
    straight = tuple(run for run in others if run.kind != "bias_sweep")
    if not biased or not straight:
        return others, doublets
    note = Note("warning", f"{', '.join(biased)} {LEFT_OUT}")
    return (replace(straight[0], notes=(*straight[0].notes, note)), *straight[1:]), doublets


def fitted_and_verified(
    runs: Sequence[Recording], verify: Sequence[Recording] = ()
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """(runs to fit, runs to verify on); by default verified on the doublets. UsageError for a run in both."""
    for run in verify:
        if not isinstance(run, Recording):
            raise UsageError(f'verify: {run!r} is no run; give runs that were read, such as [runs["run4"]]')
    fitted, doublets = divided(runs)
    checks = tuple(verify) or doublets
    refuse_overlap(fitted, checks)
    return fitted, checks


def doublets_apart(runs: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """(other runs, doublets)."""
    doublets = tuple(r for r in runs if r.kind == "doublet")
    return tuple(r for r in runs if r.kind != "doublet"), doublets


def refuse_without_sweep(runs: Sequence[Recording]) -> None:
    """DataRefused where no run can be fitted, because all are doublets or have no excitation."""
    if why := why_not_fitted(runs):
        raise DataRefused(why)


def why_not_fitted(runs: Sequence[Recording]) -> str:
    """A sentence on why no run can be fitted, "" if one can."""
    others, doublets = doublets_apart(runs)
    if not runs or not all(map(is_unexcited, others)):
        return ""
    names = ", ".join(run.name for run in doublets or others)
    if doublets:
        are = "is a doublet" if len(doublets) == 1 else "are doublets"
        return (
            f"{names} {are}; a sweep is needed: a doublet verifies a model, but it excites too few "
            "frequencies to fit one; give a sweep too"
        )
    return (
        f"no steering excitation in {names}: the steering is constant; drive a sweep, or give the column of "
        "the steering command"
    )


def refuse_overlap(sweeps: Sequence[Recording], checks: Sequence[Recording]) -> None:
    """UsageError for a run that is given twice, or both fitted and verified on; copies count as one file."""
    for group in (sweeps, checks):
        for one, two in combinations(group, 2):
            if same_recording(one, two):
                problem = "is given twice" if one.name == two.name else f"is the same recording as {one.name}"
                raise UsageError(f"{two.name} {problem}, so its noise would count as signal; give it once")
    for sweep, check in product(sweeps, checks):
        if same_recording(sweep, check):
            copied = "" if sweep.name == check.name else f" (it is the same recording as {sweep.name})"
            raise UsageError(
                f"{check.name} is used both to identify and to verify{copied}; verify on another run"
            )


def same_recording(one: Recording, two: Recording) -> bool:
    """True if both are of one drive, under any name: one file (by SHA-256), a copy, or the drive's two logs.

    Runs of one file differ in their time, or in their yaw rate if the file holds trials with restarted
    clocks. A copy, whole or in part, has the samples of the other. The two logs of one drive have the same
    clock and yaw rate.
    """
    first, second = ({digest for _, digest in run.sources} for run in (one, two))
    if not first & second:
        return _copied(one, two) or _two_logs(one, two)
    if first == second:
        return one.span == two.span and np.array_equal(one["r"].x, two["r"].x)
    shared = min(one.span[1], two.span[1]) - max(one.span[0], two.span[0])
    nested = first < second or second < first
    return nested and shared > 0.5 * min(run.span[1] - run.span[0] for run in (one, two))


def _copied(one: Recording, two: Recording) -> bool:
    """True where a block of the shorter run's yaw rates is in the other: noise never repeats.

    The block has the largest changes, so two runs at rest do not count as copies. Rounded copies count.
    """
    short, long = sorted((one["r"].x, two["r"].x), key=np.size)
    if short.size < _BLOCK or not short.std():
        return False
    turning = np.convolve(np.abs(np.diff(short, append=short[-1])), np.ones(_BLOCK), "valid")
    start = int(np.argmax(turning))
    block, alike = short[start : start + _BLOCK], _ROUNDED * short.std()
    begins = np.flatnonzero(np.abs(long[: long.size - _BLOCK + 1] - block[0]) <= alike)
    windows = np.lib.stride_tricks.sliding_window_view(long, _BLOCK)[begins]
    return bool(np.any(np.all(np.abs(windows - block) <= alike, axis=1)))


def _two_logs(one: Recording, two: Recording) -> bool:
    """True for an onboard log and a telemetry log of one drive: both have the autopilot's clock."""
    kinds = [{Path(name).suffix.lower() for name, _ in run.sources} for run in (one, two)]
    if ".tlog" not in kinds[0] ^ kinds[1] or ".bin" not in kinds[0] | kinds[1]:
        return False
    begin, end = (choose(run.span[i] for run in (one, two)) for i, choose in enumerate((max, min)))
    if end - begin < 0.5 * min(run.span[1] - run.span[0] for run in (one, two)):
        return False
    grid = np.arange(begin, end, 1 / _GRID)
    return bool(np.corrcoef(one["r"].on(grid), two["r"].on(grid))[0, 1] > _SAME_DRIVE)


def load_structures(paths: Sequence[Location | ModelStructure]) -> tuple[ModelStructure, ...]:
    """The structures of these files. UsageError with all mistakes of a file, or when two have one name."""
    found: list[ModelStructure] = []
    for path in paths:
        if isinstance(path, ModelStructure):
            found.append(path)
            continue
        try:
            found.append(structure_from_text(Path(path).read_text(encoding="utf-8")))
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"the structure {path} cannot be read: {error}") from None
        except StructureError as error:
            mistakes = str(error).replace("\n", "\n  ")
            raise UsageError(f"{path} is not a structure:\n  {mistakes}") from None
    names = [*MODELS, "kinematic", *(s.name for s in found)]
    if twice := [n for i, n in enumerate(names) if n in names[:i]]:
        raise UsageError(f"a model named {twice[0]!r} exists already; rename the structure")
    return tuple(found)


# One trial of a recording as a source: `runs.csv:3` is trial 3 of runs.csv.
#
# The label is the value in the column of `trial`, or the number of the run where the file has no such
# column. A trial in which several runs were found gives all of them.


@dataclass(frozen=True)
class TrialSource:
    """A source and the label of its only trial; "" for all trials."""

    source: str
    label: str = ""

    def chosen(self, runs: Sequence[Recording]) -> list[Recording]:
        """The runs of this trial; UsageError with the file's labels if there is none."""
        if not self.label:
            return list(runs)
        rests = {id(run): run.name.removeprefix(Path(self.source).stem).strip() for run in runs}
        for label in (self.label, f"run {self.label}"):
            if found := [run for run in runs if _is_of(label, rests[id(run)])]:
                return found
        have = ", ".join(dict.fromkeys(filter(None, rests.values())))
        many = f"its trials with a run are {have}" if have else "it has only one run; give it as a whole"
        raise UsageError(f"{Path(self.source).name} has no trial {self.label!r}: {many}")

    def without(self, others: Sequence[TrialSource], runs: Sequence[Recording]) -> list[Recording]:
        """The runs without the trials of this file that are named among other sources."""
        same = [o for o in others if o.label and Path(o.source).resolve() == Path(self.source).resolve()]
        taken = {id(run) for other in same for run in other.chosen(runs)} if not self.label else set()
        return [run for run in runs if id(run) not in taken]


def trial_source(given: str) -> TrialSource:
    """The source and its trial; a colon that belongs to the name of an existing file names no trial."""
    source, colon, label = given.rpartition(":")
    if colon and label.strip() and not Path(given).exists() and Path(source).expanduser().is_file():
        return TrialSource(source, label.strip())
    return TrialSource(given)


def refuse_missing(sources: Sequence[str]) -> None:
    """UsageError for a source of which a file does not exist."""
    for source in (trial_source(given).source for given in sources):
        for part in [source] if Path(source).expanduser().exists() else source.split("+"):
            if not Path(part).expanduser().is_dir():
                existing_log(part)


def sources_without(sources: Sequence[str], apart: Sequence[str]) -> list[str]:
    """The sources without the whole files in `apart`; its trials are left out when their file is read.

    UsageError for one that is in no source: it would stay in the fit.
    """
    places = {given: Path(trial_source(given).source).resolve() for given in (*sources, *apart)}
    for given in apart:
        if places[given] not in {places[s] for s in sources}:
            raise UsageError(f"without: {given} is none of the sources ({', '.join(sources)})")
    whole = {places[given] for given in apart if not trial_source(given).label}
    kept = [s for s in sources if places[s] not in whole]
    if not kept:
        raise UsageError("without leaves out all sources; leave some")
    return kept


def _is_of(label: str, rest: str) -> bool:
    """True where the rest of a run's name begins with a label; numbers are equal by value, 3 and 3.0."""
    if rest == label or rest.startswith(f"{label} "):
        return True
    try:
        return float(rest.partition(" ")[0]) == float(label)
    except ValueError:
        return False


@dataclass(frozen=True)
class Reading:
    """How to read the recordings. columns: the map of files of other systems (dict or path of a
    TOML file); without one, their columns are found.

    filters: {"gyro_hz", "accel_hz"} [Hz] that replace the recorded low-passes of the sensors.
    system: MAVLink id of the vehicle in a .tlog that holds several. servo: use the measured position of the
    servo as the steering, not its command. words: the options that say so on a command line, for a next step.
    """

    columns: Mapping[str, Any] | str | None = None
    filters: Mapping[str, float] | None = None
    system: int | None = None
    servo: bool = False
    words: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Runs(Shown, Sequence[Recording]):
    """Runs of one vehicle: a sequence of `Recording` that can be sliced and added; runs["run1"] finds one.

    vehicle: contents of its file; None without one (coherence can then be judged, but nothing fitted).
    """

    recordings: tuple[Recording, ...]
    vehicle: Vehicle | None = None
    vehicle_file: Path | None = None

    def __len__(self) -> int:
        return len(self.recordings)

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str):
            for run in self.recordings:
                if run.name == key:
                    return run
            raise KeyError(f"there is no run {key!r}; the names are {', '.join(r.name for r in self)}")
        found = self.recordings[key]
        return replace(self, recordings=found) if isinstance(key, slice) else found

    def __contains__(self, key: object) -> bool:
        return any(run is key or run.name == key for run in self.recordings)

    def __iter__(self) -> Iterator[Recording]:
        return iter(self.recordings)

    def __add__(self, other: Sequence[Recording]) -> Runs:
        return replace(self, recordings=(*self.recordings, *other))

    def coherence(self) -> CoherenceTable:
        """A verdict on each run: keep it, or repeat it with a change. A tuple that prints as a table.

        >>> runs.coherence()
        coherence at least 0.6, usable bands in rad/s
          run   verdict  amplitude            r           ay     vydot            p
          run1     keep     120 us  0.29 - 23.2  0.29 - 23.2  3 - 23.2  0.29 - 23.2
          run4     keep     150 us  0.98 - 36.1  0.98 - 14.1  3 - 25.1  0.98 - 14.1
        >>> runs.coherence()[0].keep
        True
        """
        return CoherenceTable(assess(run, None, self.vehicle) for run in each_with_length(self.recordings))

    def plot(self, channels: Sequence[str] | None = None, axes: Any = None) -> Any:
        """Draws every run in a column of its own and returns the matplotlib axes (channels, runs).

        channels: names, default steering, r, ay, p and speed. axes: as many to draw on; default a new figure.

        >>> runs.plot(["pwm", "r"]).shape
        (2, 2)
        """
        from rover_sweep.drawing.drawn import draw_runs

        return draw_runs(self.recordings, channels, axes)

    def to_frame(self, rate: float | None = None) -> Any:
        """All runs as one pandas.DataFrame with the index (run, t [s]); see `Recording.to_frame`.

        >>> frame = runs.to_frame(rate=50)
        >>> list(frame.index.names), frame.loc["run4"]["r"].size
        (['run', 't'], 900)
        """
        if not self.recordings:
            raise UsageError("there is no run to put into a frame")
        return joined_frames({run.name: run.to_frame(rate) for run in self.recordings}, "run")

    def table(self) -> ShortTable:
        """Name, kind, length, speed and channels of each run; the warnings."""
        rows = tuple(
            (
                r.name,
                r.kind,
                f"{r.span[1] - r.span[0]:.1f}",
                plain_number(r.mean_speed, 3),
                " ".join(r.channels),
            )
            for r in self.recordings
        )
        of = f" of {self.vehicle.name}" if self.vehicle and self.vehicle.name else ""
        headings = ("run", "kind", "s", "m/s", "channels")
        return ShortTable(
            f"{len(self)} run{'s' if len(self) != 1 else ''}{of}",
            headings,
            rows,
            grouped_warnings(self.recordings),
        )


def read(
    *sources: Location,
    vehicle: Location | Vehicle | None = None,
    columns: Mapping[str, Any] | Location | None = None,
    gyro_hz: float | None = None,
    accel_hz: float | None = None,
    system: int | None = None,
    servo: bool = False,
    without: Location | Sequence[Location] = (),
) -> Runs:
    """All runs of .BIN, .tlog or other systems' files, of pairs "log.BIN+log.tlog", or of a session's folder.

    "runs.csv:3" reads only trial 3 of a file; without=["runs.csv:3"] leaves it out, to hold it out, and
    without=["run4.BIN"] the whole file.
    vehicle: a vehicle file (rover.toml) or a `Vehicle`, needed to convert the PWM to a road-wheel angle; for
    the folder of a session, default its own file. columns: the column map of other systems' files; without
    one, the columns are found, with a note. gyro_hz, accel_hz: low-passes of the sensors [Hz, 0 = off] that
    replace the recorded ones. system: MAVLink id of the vehicle in a .tlog that holds several. servo: use the
    measured position of the servo (CSRV) as the steering; the model then excludes the servo. UsageError for
    files that cannot be opened, DataRefused for files that cannot be used.

    >>> runs = rs.read("run1.BIN", "run4.BIN", vehicle="rover.toml")
    >>> runs
    2 runs of example rover
      run      kind     s   m/s                                    channels
      run1    sweep  61.0  2.48  pwm r p ay phi psi speed vy throttle delta
      run4  doublet  18.0  2.49  pwm r p ay phi psi speed vy throttle delta
    >>> yaw_rate = runs["run1"]["r"]
    >>> yaw_rate.unit, round(yaw_rate.rate), yaw_rate.t.shape == yaw_rate.x.shape
    ('rad/s', 100, True)
    >>> rs.read("run9.BIN")
    Traceback (most recent call last):
    rover_sweep.errors.UsageError: ...
    """
    if not sources:
        raise UsageError(f"nothing to read: give the path of {READ}")
    for source in sources:
        if not isinstance(source, str | PathLike):
            raise UsageError(f"rs.read takes paths of files or folders, not {source!r}")
    if not isinstance(vehicle, str | PathLike | Vehicle | None):
        raise UsageError(f'vehicle is {vehicle!r}; give the path of a vehicle file, such as "rover.toml"')
    vehicle = kept_vehicle_file([str(source) for source in sources]) if vehicle is None else vehicle
    rover = load_vehicle(vehicle) if isinstance(vehicle, str | PathLike) else vehicle
    filters = {k: v for k, v in (("gyro_hz", gyro_hz), ("accel_hz", accel_hz)) if v is not None}
    column_map = columns if columns is None or isinstance(columns, Mapping) else str(columns)
    apart = [str(s) for s in ((without,) if isinstance(without, str | PathLike) else without)]
    kept = sources_without([str(source) for source in sources], apart)
    runs = load_runs(kept, column_map, filters or None, apart, system)
    if rover is not None:
        runs = tuple(with_delta(run, rover, servo) for run in runs)
    return Runs(runs, rover, Path(vehicle) if isinstance(vehicle, str | PathLike) else None)


def load_steered(
    sources: Sequence[str], vehicle: Vehicle, reading: Reading, other_sources: Sequence[str] = ()
) -> tuple[Recording, ...]:
    """All runs of the sources with `delta` [rad]; other_sources: as in `load_runs`."""
    runs = load_runs(sources, reading.columns, reading.filters, other_sources, reading.system)
    return tuple(with_delta(run, vehicle, reading.servo) for run in runs)


def load_runs(
    sources: Sequence[str],
    columns: Mapping[str, Any] | str | None,
    filters: Mapping[str, float] | None,
    other_sources: Sequence[str] = (),
    system: int | None = None,
) -> tuple[Recording, ...]:
    """All runs of the sources as recorded, with unique names.

    A source is a file, a trial of it or a pair for `read_runs`, or the folder of a session. other_sources:
    further sources in use, whose names must differ too; a trial among them is left out of its whole file.

    A source without a usable run, such as the log of another vehicle, is left out where others have runs: the
    first run gets a note with the reason. DataRefused where none has.
    """
    parts, others = ([trial_source(s) for s in some] for some in (sources, other_sources))
    names = source_names([part.source for part in (*parts, *others)])
    found: list[Recording] = []
    refusals: list[DataRefused] = []
    for part in parts:
        try:
            if is_session(Path(part.source)):  # named as in its plan, after its folder if there are others
                runs = session_runs(Path(part.source), filters)
                own = names[part.source]
                found += runs if len(names) == 1 else (replace(r, name=f"{own}/{r.name}") for r in runs)
                continue
            runs = read_runs(part.source, column_map=columns, filters=filters, system=system)
        except DataRefused as refused:
            refusals.append(_refusal(part, refused))
            continue
        kept = part.without(others, part.chosen(runs))
        found += [named(run, part.source, names[part.source]) for run in kept]
    if refusals and not found:
        raise refusals[0]
    if others and not found:
        raise UsageError(f"every run of {sources[0]} is used elsewhere; leave some to fit")
    if refusals:
        found[0] = replace(found[0], notes=(*found[0].notes, *map(left_out_note, refusals)))
    return with_rovers(found)


def _refusal(part: TrialSource, refused: DataRefused) -> DataRefused:
    """The refusal of a source, with the session's reason for a recording without a run."""
    words = "" if is_session(Path(part.source)) else without_run(Path(part.source))
    return DataRefused(words) if words else refused


def left_out_note(refused: DataRefused) -> Note:
    """The note on a source that was left out of several, with the reason of its refusal."""
    return Note("warning", f"left out: {refused}")


def with_delta(run: Recording, vehicle: Vehicle, servo: bool = False) -> Recording:
    """The run with `delta` [rad], from pwm and the steering of the vehicle; DataRefused without steering.

    servo: from the measured position of the servo. A model of a measured steering excludes the servo and the
    linkage that `bench` measured, which acts before it.
    """
    stop = vehicle.max_steering_angle
    if servo:
        if "servo" not in run:
            raise DataRefused(
                f"{run.name} holds no servo telemetry (CSRV) that follows the steering; "
                "omit --servo-telemetry"
            )
        run = steered(_with_holes_noted(run), *vehicle.steering(), "servo")
    if "delta" not in run:
        if "pwm" not in run:
            raise DataRefused(f"{run.name}: no steering was recorded; log RCOU, SWEP or SERVO_OUTPUT_RAW")
        run = steered(run, *vehicle.steering())
        stopped = stopped_at(run, stop.value) if stop else run
        return stopped if run["delta"].origin == "measured" else through_linkage(stopped, vehicle)
    return stopped_at(run, stop.value) if stop else run


_HOLE = 0.15  # s between two positions of a servo, from which a fast sweep turns back unseen


def _with_holes_noted(run: Recording) -> Recording:
    """The run with a warning where its servo's telemetry has holes, in which the position is interpolated."""
    t = run.manoeuvre("servo").t
    steps = np.diff(t)
    if not steps.size or (longest := float(steps.max())) <= max(_HOLE, 3 * float(np.median(steps))):
        return run
    at = float(t[int(np.argmax(steps))])
    text = (
        f"The servo's telemetry (CSRV) has holes of up to {longest:.2f} s, the longest at {at:.1f} s, in "
        "which its position is interpolated: omit --servo-telemetry, or log it without holes"
    )
    return replace(run, notes=(*run.notes, Note("warning", text)))
