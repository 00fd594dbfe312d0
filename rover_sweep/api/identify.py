"""From logs to models in Python: read runs, identify, inspect the result, report, save, load.

    import rover_sweep as rs
    runs = rs.read("run1.BIN", "run2.BIN", vehicle="rover.toml")
    result = rs.identify(runs)
    result.models["roll-yaw"]
    result.report("report")

All values are in SI units and ISO axes (x forward, y left, z up); frequencies are in rad/s. Bad input raises
`UsageError` or `DataRefused` with one sentence. A poor fit raises nothing: its verdict says so.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rover_sweep.api.identify_settings import check_settings, parameter_names
from rover_sweep.api.read import Location, Runs
from rover_sweep.api.run_roles import fitted_and_verified
from rover_sweep.api.structure_files import load_structures
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.data.vehicle_geometry import MODEL_NAMES, geometry_of
from rover_sweep.errors import UsageError
from rover_sweep.identification.grouping import FITTED, MODELS, Settings
from rover_sweep.identification.pipeline import Identification
from rover_sweep.identification.pipeline import identify as run_identification
from rover_sweep.identification.structure.state_space import ModelStructure
from rover_sweep.report.wording.provenance import Provenance, provenance
from rover_sweep.spectra.response import Band

if TYPE_CHECKING:
    from rover_sweep.report.identification.report_folder import ReportFiles


@dataclass(frozen=True, eq=False, repr=False)
class Result(Identification):
    """The result of `identify`: an `Identification` and its origin (files, command, time).

    models {name: ModelResult}, groups (of runs at one speed, with responses {output: FrequencyResponse}),
    coherence, recommended, summary, refused: see `Identification`. It prints as a table.
    """

    origin: Provenance = field(default_factory=Provenance)

    def report(
        self, directory: Location, progress: Callable[[float, str], None] | None = None
    ) -> ReportFiles:
        """Writes report.html, identification.json, pictures and models into a folder.

        progress: called with the share written, 0..1, and the name of the next part.
        """
        from rover_sweep.report.identification.report_folder import write_report

        return write_report(self, Path(directory), self.origin, progress)

    def save(self, path: Location) -> Path:
        """Writes the result and its recordings to a .json that `load_result` reads without loss."""
        from rover_sweep.api.save import dumps
        from rover_sweep.files.replaced import write_file

        return write_file(Path(path), dumps(self))


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

    verify: runs that are not fitted; default the doublets among `runs`. models: of "bicycle", "roll-yaw",
    "lumped" (the kinematic one is always added for comparison). fit: responses to fit, of "r", "ay", "vydot",
    "p". tied: one cornering stiffness for both axles. band: swept range [rad/s]; bands: {response: usable
    band [rad/s]}; windows [s]; all three default to values found from the data. free: parameters of the
    roll-yaw model that are fitted in addition, such as "Ixx", "Ixz", "h". reduction: fix those again that the
    data cannot determine, except the parameters in keep. condition_on: further inputs, such as "throttle",
    whose effect is removed from the responses. structures: your own TOML files or `ModelStructure`s, fitted
    in addition. bootstrap: replicates for the 90 % intervals (`fit["C"].interval`), 0 for none. UsageError
    for wrong arguments.
    """
    if not isinstance(runs, Runs) or runs.vehicle is None:
        raise UsageError('the vehicle is not known: read the runs with rs.read(..., vehicle="rover.toml")')
    if not len(runs):
        raise UsageError("there is no run to identify from")
    sweeps, checks = fitted_and_verified(runs, verify)
    settings = Settings(
        _known(models, MODELS, "model"),
        _known(fit, ("r", "ay", "vydot", "p"), "response"),
        tied,
        band,
        dict(bands or {}),
        tuple(windows) if windows else None,
        reduction=reduction,
        keep=parameter_names(keep),
        condition_on=_listed(condition_on),
        bootstrap=bootstrap,
    )
    freed = _known(
        parameter_names(free), tuple(MODEL_NAMES.values()), "fixed parameter of the roll-yaw model"
    )
    own = load_structures(_listed(structures))
    return identified(sweeps, checks, (runs.vehicle, runs.vehicle_file), settings, own, freed)


def identified(
    sweeps: Sequence[Recording],
    checks: Sequence[Recording],
    rover: tuple[Vehicle, Path | None],
    settings: Settings,
    structures: Sequence[ModelStructure] = (),
    free: Sequence[str] = (),
    command: str = "",
) -> Result:
    """The result of the sweeps, verified on `checks`; for `identify` and for the command line.

    rover: (vehicle, path of its file). free: parameters fitted in addition to those of the file. command: the
    command line, for the report. UsageError for settings that do not fit these runs.
    """
    check_settings(settings, sweeps)
    vehicle, vehicle_file = rover
    geometry = geometry_of(vehicle)
    geometry = replace(geometry, free=tuple(dict.fromkeys((*geometry.free, *free))))
    found = run_identification(tuple(sweeps), geometry, tuple(checks), settings, tuple(structures))
    origin = provenance(vehicle, vehicle_file, checks, command, datetime.now().astimezone())
    return Result(**{f.name: getattr(found, f.name) for f in fields(found)}, origin=origin)


def load_result(path: Location) -> Result:
    """The result that `Result.save` wrote; UsageError for another file."""
    from rover_sweep.api.save import loads

    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} cannot be read: {error}") from None
    found = loads(text, str(path))
    if not isinstance(found, Result):
        raise UsageError(f"{path} holds a {type(found).__name__}, not the result of an identification")
    return found


def _known(given: Sequence[str], known: Sequence[str], what: str) -> tuple[str, ...]:
    names = (given,) if isinstance(given, str) else tuple(given)
    for name in names:
        if name not in known:
            raise UsageError(f"there is no {what} {name!r}; choose from {', '.join(known)}")
    return names


def _listed(given: Any) -> tuple[Any, ...]:
    """The arguments as a tuple; a single one becomes a tuple of one."""
    return (given,) if isinstance(given, str | os.PathLike | ModelStructure) else tuple(given)
