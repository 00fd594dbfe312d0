"""From logs to models in Python: read runs, identify, inspect the result, report, save, load.

All values are in SI units and ISO axes (x forward, y left, z up); frequencies are in rad/s. Bad input raises
`UsageError` or `DataRefused` with one sentence. A poor fit raises nothing: its verdict says so.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from rover_sweep.api.known_steering import known
from rover_sweep.api.read import Location, Runs, fitted_and_verified, load_structures
from rover_sweep.data.recording import OUTPUTS, Recording, joined_frames
from rover_sweep.data.results import ByName, Progress
from rover_sweep.data.vehicle_file import MODELS, Vehicle
from rover_sweep.data.vehicle_geometry import MODEL_NAMES, geometry_of, tolerances_of
from rover_sweep.errors import UsageError
from rover_sweep.identification.grouping import FITTED, Settings
from rover_sweep.identification.model_results import PHYSICAL, ModelResult
from rover_sweep.identification.models import COLUMNS, ROWS
from rover_sweep.identification.pipeline import Identification, identified_runs, usable
from rover_sweep.identification.pipeline import identify as run_identification
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.report.wording import Provenance, provenance
from rover_sweep.spectra.response import Band, FrequencyResponse

if TYPE_CHECKING:
    from rover_sweep.report.identification.report import ReportFiles

STEERED = ("delta", "pwm", "r", "p", "phi", "psi", "ay", "vy")


def parameter_names(names: Sequence[str]) -> tuple[str, ...]:
    """Model parameters, given by name or by key of the vehicle file; UsageError for unknown names."""
    derivatives = [f"{row}_{column}" for row in ROWS for column in COLUMNS]
    known = [*MODEL_NAMES.values(), "C", "Cf", "Cr", "k_phi", "b_phi", "tau", *derivatives]
    found = tuple(MODEL_NAMES.get(name, name) for name in names)
    for name in found:
        if name not in known:
            raise UsageError(f"there is no parameter {name!r}; choose from {', '.join(known)}")
    return found


def check_settings(settings: Settings, runs: Sequence[Recording]) -> None:
    """UsageError for settings that are impossible with these runs."""
    longest = max(run.span[1] - run.span[0] for run in runs)
    fastest = math.pi * min(run.manoeuvre(c).rate for run in runs for c in ("delta", "r") if c in run)
    limits = (x for band in settings.bands.values() for x in band)
    numbers = [*(settings.band or ()), *(settings.windows or ()), *limits]
    if not all(math.isfinite(x) for x in numbers):
        raise UsageError("frequencies and window lengths must be finite numbers")
    if "r" not in settings.fitted:
        raise UsageError("the fit needs the yaw rate: --fit r, r,ay or r,ay,p")
    if settings.bootstrap != 0 and settings.bootstrap < 20:
        raise UsageError(
            f"{settings.bootstrap} bootstrap replicates are too few; use 20 or more, or 0 for none"
        )
    if settings.windows and not 0.5 <= min(settings.windows) <= max(settings.windows) <= longest:
        raise UsageError(f"window lengths must be between 0.5 s and the longest run, {longest:.3g} s")
    if settings.band and settings.band[1] > fastest:
        raise UsageError(
            f"--wmax {settings.band[1]:g} is above the highest frequency of these logs, {fastest:.3g} rad/s "
            "(half the sampling rate of steering or yaw rate)"
        )
    if settings.band and settings.band[0] < 2 * math.pi / longest:
        raise UsageError(
            f"--wmin {settings.band[0]:g} rad/s has a period longer than the longest run, {longest:.3g} s"
        )
    for name in settings.condition_on:
        if name in STEERED:
            raise UsageError(f"{name} is the steering or follows it; condition on an independent input")
        if lacking := [run for run in runs if name not in run]:
            there = ", ".join(c for c in lacking[0].channels if c not in STEERED) or "nothing else"
            raise UsageError(f"{lacking[0].name} has no {name!r} to condition on; it holds {there}")
    for name, (low, high) in settings.bands.items():
        if high > fastest or low < 2 * math.pi / longest or high < 1.5 * low:
            within = f"{2 * math.pi / longest:.2g} and {fastest:.3g} rad/s"
            raise UsageError(
                f"--band {name}={low:g}:{high:g} must be between {within} and span a factor of 1.5 or more"
            )


CHANNELS = {"r": "r", "ay": "ay", "p": "p", "vydot": "vy"}  # {response: what is recorded of it}
SEED = 1


@threadpool_limits.wrap(limits=1, user_api="blas")  # so that sums do not depend on the number of threads
def with_numbers(found: Identification, vehicle: Vehicle) -> Identification:
    """The identification with `numbers`, or with a sentence on why there are none.

    Numbers only if the most complete model with tyres that the runs determine is recommended, and differs
    from the runs by at most noise and normal tolerances: a wrong model does not describe the rover.
    """
    models = usable(found)
    name = next((n for n in PHYSICAL if n in models), "")  # the most complete one that the runs determine
    if not name or found.recommended != name:
        return found
    from rover_sweep.diagnosis.posterior.parameter_intervals import fitted_baseline, rover_numbers
    from rover_sweep.diagnosis.verdict import NOTABLE

    wanted = {CHANNELS.get(output) for output in models[name].fit.costs}
    left_out = set(CHANNELS.values()) - wanted
    runs = [
        replace(run, channels={c: s for c, s in run.channels.items() if c not in left_out})
        for run in identified_runs(found)
        if run.mean_speed > 0
    ]
    if not runs:
        why = "numbers with normal tolerances need runs forward: all of these were driven in reverse"
        return replace(found, summary=(*found.summary, why))
    spread = known(vehicle, tolerances_of(vehicle)).spread
    fitted = fitted_baseline(runs, found.geometry, name, spread)  # type: ignore[arg-type]
    if fitted is None:
        return found
    channel, misfit = max(fitted.misfit.items(), key=lambda item: item[1])
    if misfit > NOTABLE:
        why = (
            f"the {name} model differs from the runs by {misfit**0.5:.1f} times the noise in {channel}, more "
            "than normal tolerances of a rover: its numbers hold for the fitted responses alone; "
            "`rover-sweep diagnose` with the same runs finds what it leaves out"
        )
        return replace(found, summary=(*found.summary, why), residual=fitted.misfit)
    return replace(
        found,
        residual=fitted.misfit,
        numbers=ByName(v for v in rover_numbers(fitted, SEED) if v.low is not None and v.high is not None),
    )


ONE = (str, os.PathLike, ModelStructure, Recording)  # given alone instead of in a sequence


@dataclass(frozen=True, eq=False, repr=False)
class Result(Identification):
    """The result of `identify`: an `Identification` and its origin (files, command, time).

    models {name: ModelResult}, groups (of runs at one speed, with responses {output: FrequencyResponse}),
    coherence, recommended, summary, refused: see `Identification`. It prints as a table.
    """

    origin: Provenance = field(default_factory=Provenance)

    @property
    def responses(self) -> Mapping[str, FrequencyResponse]:
        """{output: response} of the first group of runs (all runs, if they have one speed).

        >>> result.responses["r"].unit
        'rad/s per rad'
        """
        return self.groups[0].responses

    def plot(
        self,
        outputs: Sequence[str] | None = None,
        models: Sequence[str] | None = None,
        group: int = 0,
        axes: Any = None,
    ) -> Any:
        """Draws the responses with the models over them; returns matplotlib axes (3, outputs).

        Rows: magnitude, phase, coherence. outputs, models: names, default all responses and the models of the
        report. group: index of the group of runs at one speed. axes: as many to draw on; default a new
        figure. UsageError for unknown names or another number of axes.

        >>> result.plot(["r", "ay"], models=["roll-yaw"]).shape
        (3, 2)
        """
        from rover_sweep.drawing.drawn import draw_responses

        return draw_responses(self, outputs, models, group, axes)

    def to_frame(self) -> Any:
        """The parameters of all models as a pandas.DataFrame with the index (model, parameter).

        Columns: see `ModelResult.to_frame`. UsageError without pandas or without a model.

        >>> frame = result.to_frame()
        >>> list(frame.index.names), frame.loc["roll-yaw", "Izz"]["unit"]
        (['model', 'parameter'], 'kg m^2')
        """
        if not self.models:
            raise UsageError(
                "no model was identified, so there are no parameters; print the result for the reason"
            )
        return joined_frames({name: model.to_frame() for name, model in self.models.items()}, "model")

    def report(
        self, directory: Location = "report", progress: Progress | None = None, units: str = "SI"
    ) -> ReportFiles:
        """Writes report.html, identification.json, pictures and models into a folder, default "report".

        progress: called with the name of the next part and the share written, 0..1. units: of the
        accelerations on the page, "SI" or "paper" (ft/s^2); the documents are in SI. UsageError for others.

        >>> result.report("report").page.name
        'report.html'
        """
        from rover_sweep.report.identification.report import write_report
        from rover_sweep.report.wording import SHOWN_UNITS

        if units not in SHOWN_UNITS:
            raise UsageError(f"there are no units {units!r}; choose from {', '.join(SHOWN_UNITS)}")
        return write_report(self, Path(directory), self.origin, progress, SHOWN_UNITS[units])

    def save(self, path: Location) -> Path:
        """Writes the result and its recordings to a .json that `load_result` reads without loss."""
        from rover_sweep.api.save import dumps
        from rover_sweep.files.documents import write_file

        return write_file(Path(path), dumps(self))


def bode(*given: Result | ModelResult, outputs: Sequence[str] | None = None, axes: Any = None) -> Any:
    """Draws the measured responses of a result with the given models over them; matplotlib axes (3, outputs).

    given: models and one `Result`, whose first group of runs was measured. Rows: magnitude, phase, coherence.
    A model is named after its structure, numbered where names repeat. Models of another result are drawn at
    the speed of this one. outputs, axes: as in `Result.plot`. UsageError without exactly one result.

    >>> rs.bode(result.models["bicycle"], result.models["roll-yaw"], result, outputs=["r"]).shape
    (3, 1)
    """
    from rover_sweep.drawing.drawn import draw_responses

    measured = [one for one in given if isinstance(one, Result)]
    if len(measured) != 1 or not all(isinstance(one, Result | ModelResult) for one in given):
        raise UsageError("rs.bode takes models and one result, as in rs.bode(model_a, model_b, result)")
    models: dict[str, ModelResult] = {}
    for model in (one for one in given if isinstance(one, ModelResult)):
        name = model.fit.structure.name
        again = sum(1 for known in models if known.partition(" (")[0] == name) + 1
        models[name if again == 1 else f"{name} ({again})"] = model
    shown = replace(measured[0], models=models)
    return draw_responses(shown, outputs, list(models), 0, axes)


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
    "p". tied: begin with one cornering stiffness C for both axles, as the paper; Cf and Cr replace it where
    they fit much better, and C is then the variant "one C for both axles". False: Cf and Cr. band: swept
    range [rad/s]; bands: {response: usable band [rad/s]}; windows [s]; all three default to values found from
    the data. free: parameters of the roll-yaw model that are fitted in addition, such as "Ixx", "Ixz", "h".
    reduction: fix those again that the data cannot determine, except the parameters in keep. condition_on:
    further inputs, such as "throttle", whose effect is removed from the responses. structures: your own TOML
    files or `ModelStructure`s, fitted in addition. bootstrap: replicates for the 90 % intervals
    (`parameters["C"].interval_90`), 0 for none.
    UsageError for wrong arguments.

    >>> runs = rs.read("run1.BIN", "run4.BIN", vehicle="rover.toml")
    >>> result = rs.identify(runs, models=["roll-yaw"], bootstrap=0)
    >>> list(result.models)
    ['kinematic', 'roll-yaw']
    >>> model = result.models["roll-yaw"]
    >>> model.verdict.level, model.verification[0].run
    ('good', 'run4')
    >>> yaw_inertia = model.parameters["Izz"]
    >>> f"{yaw_inertia.value:.2f} {yaw_inertia.unit}"
    '0.07 kg m^2'
    >>> rs.identify(runs, models=["tricycle"])
    Traceback (most recent call last):
    rover_sweep.errors.UsageError: there is no model 'tricycle'; choose from bicycle, roll-yaw, lumped
    """
    if not isinstance(runs, Runs) or runs.vehicle is None:
        raise UsageError('the vehicle is not known: read the runs with rs.read(..., vehicle="rover.toml")')
    if not len(runs):
        raise UsageError("there is no run to identify from")
    sweeps, checks = fitted_and_verified(runs, _listed(verify))
    settings = Settings(
        _known(models, MODELS, "model"),
        _known(fit, ("r", "ay", "vydot", "p"), "response"),
        tied,
        None if band is None else _band(band, "band"),
        _bands(bands or {}),
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
    fitted: Callable[[Mapping[str, ModelResult]], None] | None = None,
) -> Result:
    """The result of the sweeps, verified on `checks`; for `identify` and for the command line.

    rover: (vehicle, path of its file). free: parameters fitted in addition to those of the file. command: the
    command line, for the report. fitted: called with the models before their intervals. UsageError for
    settings that do not fit these runs.
    """
    check_settings(settings, sweeps)
    vehicle, vehicle_file = rover
    geometry = geometry_of(vehicle)
    geometry = replace(geometry, free=tuple(dict.fromkeys((*geometry.free, *free))))
    found = run_identification(
        tuple(sweeps), geometry, tuple(checks), settings, tuple(structures), fitted, vehicle
    )
    found = with_numbers(found, vehicle) if settings.bootstrap else found
    origin = provenance(vehicle, vehicle_file, checks, command, datetime.now().astimezone())
    return Result(**{f.name: getattr(found, f.name) for f in fields(found)}, origin=origin)


def load_result(path: Location) -> Result:
    """The result that `Result.save` wrote; UsageError for another file.

    >>> again = rs.load_result(result.save("result.json"))
    >>> again.models["roll-yaw"].parameters["tau"].value == result.models["roll-yaw"].parameters["tau"].value
    True
    """
    from rover_sweep.api.save import loads, text_of

    if Path(path).is_dir():
        raise UsageError(f"{path} is a folder; give the file that `result.save(FILE)` wrote")
    found = loads(text_of(Path(path)), str(path))
    if not isinstance(found, Result):
        raise UsageError(f"{path} holds a {type(found).__name__}, not the result of an identification")
    return found


def _known(given: Sequence[str], known: Sequence[str], what: str) -> tuple[str, ...]:
    names = _listed(given)
    for name in names:
        if name not in known:
            raise UsageError(f"there is no {what} {name!r}; choose from {', '.join(known)}")
    return names


def _bands(given: Mapping[str, Band]) -> dict[str, Band]:
    if not isinstance(given, Mapping):
        raise UsageError(
            f'bands is {given!r}; give a usable band for a response, as {{"r": (2, 30)}} [rad/s]'
        )
    _known(tuple(given), OUTPUTS, "response")
    return {name: _band(band, f"the band of {name}") for name, band in given.items()}


def _band(given: Any, what: str) -> Band:
    try:
        low, high = (float(x) for x in given)
    except (TypeError, ValueError):
        raise UsageError(f"{what} is {given!r}; give (lowest, highest) frequency [rad/s]") from None
    return low, high


def _listed(given: Any) -> tuple[Any, ...]:
    """The arguments as a tuple; a single one becomes a tuple of one."""
    return tuple(given) if isinstance(given, Iterable) and not isinstance(given, ONE) else (given,)
