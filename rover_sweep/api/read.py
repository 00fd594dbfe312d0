"""Reads runs from files: `rs.read`, and functions for the command line with several groups of files.

A source is a .BIN, .tlog or .csv, one trial of it as "runs.csv:3", a pair "log.BIN+log.tlog", or the folder
of a session.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from rover_sweep.api.known_steering import through_linkage
from rover_sweep.api.trial_source import sources_without, trial_source
from rover_sweep.data.recording import Recording, grouped_warnings, steered
from rover_sweep.data.result_table import ShortTable, Shown, plain_number
from rover_sweep.data.run_names import named, source_names
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_file import load as load_vehicle
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.logs.read import read_runs
from rover_sweep.quality.coherence import CoherenceTable, assess
from rover_sweep.quality.length import each_with_length
from rover_sweep.quality.rovers import with_rovers
from rover_sweep.quality.steering_lock import stopped_at
from rover_sweep.session.folder import is_session, kept_vehicle_file
from rover_sweep.session.recordings import session_runs

Location = str | PathLike[str]


@dataclass(frozen=True)
class Reading:
    """How to read the recordings. columns: the map of a .csv (dict or path of a TOML file).

    filters: {"gyro_hz", "accel_hz"} [Hz] that replace the recorded low-passes of the sensors.
    system: MAVLink id of the vehicle in a .tlog that holds several.
    """

    columns: Mapping[str, Any] | str | None = None
    filters: Mapping[str, float] | None = None
    system: int | None = None


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
            return self._named(key)
        found = self.recordings[key]
        return replace(self, recordings=found) if isinstance(key, slice) else found

    def _named(self, name: str) -> Recording:
        for run in self.recordings:
            if run.name == name:
                return run
        raise KeyError(f"there is no run {name!r}; the names are {', '.join(r.name for r in self)}")

    def __contains__(self, key: object) -> bool:
        return any(run is key or run.name == key for run in self.recordings)

    def __iter__(self) -> Iterator[Recording]:
        return iter(self.recordings)

    def __add__(self, other: Sequence[Recording]) -> Runs:
        return replace(self, recordings=(*self.recordings, *other))

    def coherence(self) -> CoherenceTable:
        """A verdict on each run: keep it, or repeat it with which change. A tuple that prints as a table.

        >>> runs.coherence()
        coherence at least 0.6, usable bands in rad/s
          run   verdict  amplitude            r           ay     vydot            p
          run1     keep     120 us  0.29 - 23.2  0.29 - 23.2  3 - 23.2  0.29 - 23.2
          run4     keep     150 us  0.98 - 36.1  0.98 - 14.1  3 - 25.1  0.98 - 14.1
        >>> runs.coherence()[0].keep
        True
        """
        return CoherenceTable(assess(run) for run in each_with_length(self.recordings))

    def plot(self, channels: Sequence[str] | None = None, axes: Any = None) -> Any:
        """Draws every run in a column of its own and returns the matplotlib axes (channels, runs).

        channels: names, default steering, r, ay, p and speed. axes: as many to draw on; default a new figure.

        >>> runs.plot(["pwm", "r"]).shape
        (2, 2)
        """
        from rover_sweep.drawing.of_run import draw_runs

        return draw_runs(self.recordings, channels, axes)

    def to_frame(self, rate: float | None = None) -> Any:
        """All runs as one pandas.DataFrame with the index (run, t [s]); see `Recording.to_frame`.

        >>> frame = runs.to_frame(rate=50)
        >>> list(frame.index.names), frame.loc["run4"]["r"].size
        (['run', 't'], 900)
        """
        if not self.recordings:
            raise UsageError("there is no run to put into a frame")
        from rover_sweep.data.later import joined_frames

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
    without: Location | Sequence[Location] = (),
) -> Runs:
    """All runs of .BIN, .tlog or .csv files, of pairs "log.BIN+log.tlog", or of the folder of a session.

    "runs.csv:3" reads only trial 3 of a file; without=["runs.csv:3"] leaves it out, to hold it out, and
    without=["run4.BIN"] the whole file.
    vehicle: a vehicle file (rover.toml) or a `Vehicle`, needed to convert the PWM to a road-wheel angle; for
    the folder of a session, default its own file. columns: the column map of a .csv. gyro_hz, accel_hz:
    low-passes of the sensors [Hz, 0 = off] that replace the recorded ones. system: MAVLink id of the vehicle
    in a .tlog that holds several. UsageError for files that cannot be opened, DataRefused for files that
    cannot be used.

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
        raise UsageError("nothing to read: give the path of a .BIN, .tlog or .csv")
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
        runs = tuple(with_delta(run, rover) for run in runs)
    return Runs(runs, rover, Path(vehicle) if isinstance(vehicle, str | PathLike) else None)


def load_steered(
    sources: Sequence[str], vehicle: Vehicle, reading: Reading, other_sources: Sequence[str] = ()
) -> tuple[Recording, ...]:
    """All runs of the sources with `delta` [rad]; other_sources: as in `load_runs`."""
    runs = load_runs(sources, reading.columns, reading.filters, other_sources, reading.system)
    return tuple(with_delta(run, vehicle) for run in runs)


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
    """
    parts, others = ([trial_source(s) for s in some] for some in (sources, other_sources))
    names = source_names([part.source for part in (*parts, *others)])
    found: list[Recording] = []
    for part in parts:
        if is_session(Path(part.source)):
            found += _of_session(part.source, filters, names)
        else:
            runs = read_runs(part.source, column_map=columns, filters=filters, system=system)
            kept = part.without(others, part.chosen(runs))
            found += [named(run, part.source, names[part.source]) for run in kept]
    if others and not found:
        raise UsageError(f"every run of {sources[0]} is used elsewhere; leave some to fit")
    return with_rovers(found)


def _of_session(
    source: str, filters: Mapping[str, float] | None, names: Mapping[str, str]
) -> tuple[Recording, ...]:
    """Runs with the names of the plan; with the folder's name in front if there are other sources."""
    runs = session_runs(Path(source), filters)
    return runs if len(names) == 1 else tuple(replace(r, name=f"{names[source]}/{r.name}") for r in runs)


def with_delta(run: Recording, vehicle: Vehicle) -> Recording:
    """The run with `delta` [rad], from pwm and the steering of the vehicle; DataRefused without steering."""
    stop = vehicle.max_steering_angle
    if "delta" not in run:
        if "pwm" not in run:
            raise DataRefused(f"{run.name}: no steering was recorded; log RCOU, SWEP or SERVO_OUTPUT_RAW")
        run = steered(run, *vehicle.steering())
        return through_linkage(stopped_at(run, stop.value) if stop else run, vehicle)
    return stopped_at(run, stop.value) if stop else run
