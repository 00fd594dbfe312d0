"""From logs to models in Python: `read` runs, `identify`, look at the result, report, save, load.

    import rover_sweep as rs
    runs = rs.read("run1.BIN", "run2.BIN", vehicle="rover.toml")
    result = rs.identify(runs)
    result.models["roll-yaw"]
    result.report("report")

Everything is in SI units and ISO axes (x forward, y left, z up); frequencies are in rad/s. Bad input
raises `UsageError` or `DataRefused` with one sentence; a poor fit is a result that says so.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from datetime import datetime
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rover_sweep.errors import UsageError
from rover_sweep.identify.grouping import FITTED, MODELS, Settings
from rover_sweep.identify.identification import Identification
from rover_sweep.identify.identification import identify as run_identification
from rover_sweep.identify.quality import CoherenceVerdict, assess
from rover_sweep.identify.recording import Recording
from rover_sweep.identify.response import Band
from rover_sweep.identify.soundness.length import each_with_length
from rover_sweep.identify.structure import ModelStructure
from rover_sweep.identify.table import ShortTable, Shown, number
from rover_sweep.preparation import (
    MODEL_NAMES,
    check_settings,
    divided,
    geometry_of,
    load_runs,
    parameter_names,
    refuse_overlap,
    with_delta,
)
from rover_sweep.report.provenance import Provenance, provenance
from rover_sweep.session_folder.folder import kept_vehicle_file
from rover_sweep.structure_file import load_structures
from rover_sweep.vehicle_file import Vehicle
from rover_sweep.vehicle_file import load as load_vehicle

if TYPE_CHECKING:
    from rover_sweep.report.write import ReportFiles

Location = str | PathLike[str]


@dataclass(frozen=True, eq=False, repr=False)
class Runs(Shown, Sequence[Recording]):
    """Runs of one vehicle: a sequence of `Recording` that can be sliced and added.

    vehicle: what its file says, None without one (then coherence can be judged, and nothing fitted).
    """

    recordings: tuple[Recording, ...]
    vehicle: Vehicle | None = None
    vehicle_file: Path | None = None

    def __len__(self) -> int:
        return len(self.recordings)

    def __getitem__(self, key: Any) -> Any:
        found = self.recordings[key]
        return replace(self, recordings=found) if isinstance(key, slice) else found

    def __iter__(self) -> Iterator[Recording]:
        return iter(self.recordings)

    def __add__(self, other: Sequence[Recording]) -> Runs:
        return replace(self, recordings=(*self.recordings, *other))

    def coherence(self) -> tuple[CoherenceVerdict, ...]:
        """The quick verdict on each run: keep it, or repeat it with what."""
        return tuple(assess(run) for run in each_with_length(self.recordings))

    def table(self) -> ShortTable:
        """Name, kind, length, speed and channels of each run, and the warnings."""
        rows = tuple(
            (r.name, r.kind, f"{r.span[1] - r.span[0]:.1f}", number(r.mean_speed, 3), " ".join(r.channels))
            for r in self.recordings
        )
        told: dict[str, list[str]] = {}
        for r in self.recordings:
            for note in (n for n in r.notes if n.level == "warning"):
                told.setdefault(note.text, []).append(r.name)
        warnings = (
            f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''}: {text}"
            for text, names in told.items()
        )
        of = f" of {self.vehicle.name}" if self.vehicle and self.vehicle.name else ""
        headings = ("run", "kind", "s", "m/s", "channels")
        return ShortTable(f"{len(self)} run(s){of}", headings, rows, tuple(warnings))


@dataclass(frozen=True, eq=False, repr=False)
class Result(Identification):
    """What `identify` found: an `Identification` that knows where it comes from.

    models {name: ModelResult}, groups (of runs at one speed, with responses {output: FrequencyResponse}),
    coherence, recommended, summary, refused: see `Identification`. It prints itself as a table.
    """

    origin: Provenance = field(default_factory=Provenance)

    def report(self, directory: Location) -> ReportFiles:
        """Writes report.html, identification.json, pictures and models into a folder."""
        from rover_sweep.report.write import write_report

        return write_report(self, Path(directory), self.origin)

    def save(self, path: Location) -> Path:
        """Writes everything, recordings as well, into a .json that `load_result` reads back without loss."""
        from rover_sweep.report.files import write_file
        from rover_sweep.saved import dumps

        return write_file(Path(path), dumps(self))


def read(
    *sources: Location,
    vehicle: Location | Vehicle | None = None,
    columns: Mapping[str, Any] | Location | None = None,
    gyro_hz: float | None = None,
    accel_hz: float | None = None,
    system: int | None = None,
) -> Runs:
    """All runs of .BIN, .tlog or .csv files, of pairs "log.BIN+log.tlog", or of the folder of a session.

    vehicle: a vehicle file (rover.toml) or a `Vehicle`, which makes the PWM a road-wheel angle; of a
    session its own, if not given.
    columns: the column map of a .csv. gyro_hz, accel_hz: sensor low-passes [Hz, 0 = off] in place of
    the recorded ones. system: MAVLink id of the vehicle in a .tlog that holds several. Raises UsageError for
    what cannot be opened, DataRefused for what cannot be used.
    """
    if not sources:
        raise UsageError("nothing to read: give the path of a .BIN, .tlog or .csv")
    vehicle = kept_vehicle_file([str(source) for source in sources]) if vehicle is None else vehicle
    rover = load_vehicle(vehicle) if isinstance(vehicle, str | PathLike) else vehicle
    filters = {k: v for k, v in (("gyro_hz", gyro_hz), ("accel_hz", accel_hz)) if v is not None}
    column_map = columns if columns is None or isinstance(columns, Mapping) else str(columns)
    runs = load_runs([str(source) for source in sources], column_map, filters or None, system=system)
    if rover is not None:
        runs = tuple(with_delta(run, rover) for run in runs)
    return Runs(runs, rover, Path(vehicle) if isinstance(vehicle, str | PathLike) else None)


def identify(
    runs: Runs,
    verify: Sequence[Recording] = (),
    *,
    models: Sequence[str] = MODELS,
    fit: Sequence[str] = FITTED,
    tied: bool = True,
    band: Band | None = None,
    bands: Mapping[str, Band] | None = None,
    windows: Sequence[float] | None = None,
    free: Sequence[str] = (),
    reduction: bool = True,
    keep: Sequence[str] = (),
    condition_on: Sequence[str] = (),
    structures: Sequence[Location | ModelStructure] = (),
    bootstrap: int = 200,
) -> Result:
    """Identifies models from runs and verifies them on other runs.

    verify: runs that the fit must not see; without any, the doublets among `runs`. models: of
    "bicycle", "roll-yaw", "lumped" (the kinematic one is always there to compare). fit: the responses
    fitted, of "r", "ay", "vydot", "p". tied: one cornering stiffness for both axles. band: swept range
    [rad/s]; bands: usable band of a response [rad/s]; windows [s]: found from the data where not given.
    free: parameters of the roll-yaw model that are fitted beyond the usual ones, such as "Ixx", "Ixz",
    "h". reduction: fix again what the data cannot tell, but none of the parameters in keep.
    condition_on: channels that move the rover beside the steering, such as "throttle", which are taken
    out of the responses. structures: files of your own, or `ModelStructure`s, fitted beside the models.
    bootstrap: replicates for the 90 % intervals (`fit["C"].interval`), 0 for none.
    """
    if not isinstance(runs, Runs) or runs.vehicle is None:
        raise UsageError('the vehicle is not known: rs.read(..., vehicle="rover.toml")')
    if not len(runs):
        raise UsageError("there is no run to identify from")
    sweeps, doublets = divided(runs)
    checks = tuple(verify) or doublets
    refuse_overlap(sweeps, checks)
    settings = Settings(
        _known(models, MODELS, "model"), _known(fit, ("r", "ay", "vydot", "p"), "response"), tied, band,
        dict(bands or {}), tuple(windows) if windows else None,
        reduction=reduction, keep=parameter_names(keep), condition_on=_listed(condition_on),
        bootstrap=bootstrap,
    )  # fmt: skip
    check_settings(settings, sweeps)
    geometry = geometry_of(runs.vehicle)
    freed = _known(parameter_names(free), tuple(MODEL_NAMES.values()), "known number of the roll-yaw model")
    geometry = replace(geometry, free=tuple(dict.fromkeys((*geometry.free, *freed))))
    found = run_identification(sweeps, geometry, checks, settings, load_structures(_listed(structures)))
    origin = provenance(runs.vehicle, runs.vehicle_file, checks, "", datetime.now().astimezone())
    return Result(**{f.name: getattr(found, f.name) for f in fields(found)}, origin=origin)


def load_result(path: Location) -> Result:
    """The result that `Result.save` wrote. Raises UsageError for a file that is none."""
    from rover_sweep.saved import loads

    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} cannot be read: {error}") from None
    found = loads(text, str(path))
    if not isinstance(found, Result):
        raise UsageError(f"{path} holds a {type(found).__name__} and no result of an identification")
    return found


def _known(given: Sequence[str], known: Sequence[str], what: str) -> tuple[str, ...]:
    names = (given,) if isinstance(given, str) else tuple(given)
    for name in names:
        if name not in known:
            raise UsageError(f"there is no {what} {name!r}; choose from {', '.join(known)}")
    return names


def _listed(given: Any) -> tuple[Any, ...]:
    """A single name or structure counts as a list of one."""
    return (given,) if isinstance(given, str | os.PathLike | ModelStructure) else tuple(given)
