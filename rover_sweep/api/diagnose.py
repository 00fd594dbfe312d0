"""Diagnosis in Python: find what a model lacks, and show, report, save or load the result."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rover_sweep.api.diagnosis_input import candidates_left, diagnosed, material, nominal_of, time_limit_of
from rover_sweep.api.read import Location, Runs
from rover_sweep.comparison.answer import Comparison
from rover_sweep.comparison.common_model import FittedSide
from rover_sweep.comparison.compare import Compared
from rover_sweep.comparison.compare import compare as sides_compared
from rover_sweep.comparison.differences import Known
from rover_sweep.data.recording import Recording, keyed_frame
from rover_sweep.data.results import Progress, ShortTable, Shown, ends_words, plain_number
from rover_sweep.diagnosis.result import BASELINES, Diagnosis, DiagnosisSettings
from rover_sweep.diagnosis.simulation.experiment import experiment, in_order
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.files.documents import read_json
from rover_sweep.report.diagnosis.diagnosis_json import DiagnosisOrigin
from rover_sweep.report.wording import provenance

if TYPE_CHECKING:
    from rover_sweep.report.diagnosis.report import DiagnosisFiles


@dataclass(frozen=True, eq=False, repr=False)
class FullDiagnosis(Shown, Diagnosis):
    """The result of `diagnose`: a `Diagnosis` with its origin, shown as a table."""

    origin: DiagnosisOrigin = field(default_factory=DiagnosisOrigin)

    def table(self) -> ShortTable:
        """Findings with parameters, intervals, look-alikes and share removed; then unknown and cannot_see."""
        rows = []
        for f in self.findings:
            removed = next((h.share_removed for h in f.held_out), None)
            share = "-" if removed is None else f"{100 * min(removed, 1.0):.0f} %"
            for k, v in enumerate(f.parameters):
                names = (f.effect, ", ".join(f.look_alikes) or "-", share) if k == 0 else ("", "", "")
                interval = ends_words(v.low, v.high)
                rows.append((names[0], v.name, plain_number(v.value, 3), interval, v.unit, *names[1:]))
        headings = ("left out", "", "value", "90 %", "unit", "or else", "removed")
        notes = [f"unknown in {self.unknown.channel}: {self.unknown.sentence}"] if self.unknown else []
        from rover_sweep.report.wording import hiding_words, title

        hiding = hiding_words(self.cannot_see)
        notes += [f"could still hide (95 %): {hiding}"] if hiding else []
        unseen = ", ".join(title(u.effect) for u in self.cannot_see if not u.up_to)
        notes += [f"these runs cannot show: {unseen}"] if unseen else []
        return ShortTable(f"{self.verdict}: {self.sentence}", headings, tuple(rows), tuple(notes))

    def plot(self, run: str | None = None, axes: Any = None) -> Any:
        """Draws a run measured, simulated before and after; returns matplotlib axes (channels, 2).

        Left: signals over time with twice the noise (grey). Right: residual over noise by frequency. run: its
        name, default the first held-out one. axes: as many to draw on; default a new figure. UsageError for
        an unknown run, or for a diagnosis without signals (read from a diagnosis.json).

        >>> found.plot("run4").shape[1]
        2
        """
        from rover_sweep.drawing.drawn import draw_diagnosis

        return draw_diagnosis(self, run, axes)

    def plot_curves(self, axes: Any = None) -> Any:
        """Draws `curves` with their 90 % bands; returns matplotlib axes (n,), one for each curve.

        axes: as many to draw on; default a new figure. UsageError without a curve.
        """
        from rover_sweep.drawing.drawn import draw_curves

        return draw_curves(self.curves, axes)

    def to_frame(self) -> Any:
        """The findings as a pandas.DataFrame with the index (effect, parameter); UsageError without pandas.

        Columns: value, low and high (90 % interval, nan for no such limit), unit, meaning, removed (share of
        the held-out misfit that the effect explains, nan without a held-out run). No row without a finding.

        >>> list(found.to_frame().columns)
        ['value', 'low', 'high', 'unit', 'meaning', 'removed']
        """
        rows = [(f, v) for f in self.findings for v in f.parameters]
        removed = {f.effect: next((h.share_removed for h in f.held_out), None) for f in self.findings}
        columns = {
            name: [getattr(v, name) for _, v in rows] for name in ("value", "low", "high", "unit", "meaning")
        }
        columns["removed"] = [removed[f.effect] for f, _ in rows]
        return keyed_frame(
            columns, {"effect": [f.effect for f, _ in rows], "parameter": [v.name for _, v in rows]}
        )

    def report(self, directory: Location) -> DiagnosisFiles:
        """Write diagnosis.html and diagnosis.json into a folder."""
        from rover_sweep.report.diagnosis.report import write_diagnosis

        return write_diagnosis(self, Path(directory), self.origin)

    def save(self, path: Location) -> Path:
        """Write everything, with the recordings, into a .json that `load_diagnosis` reads without loss."""
        from rover_sweep.api.save import dumps
        from rover_sweep.files.documents import write_file

        return write_file(Path(path), dumps(self))


def diagnose(
    runs: Runs,
    held_out: Sequence[Recording] = (),
    *,
    baseline: str | None = None,
    model: Location | None = None,
    simulated: Sequence[Recording] = (),
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    time_limit: float | None = None,
    seed: int = 1,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
) -> FullDiagnosis:
    """Find the physics that a model lacks: where, which effect, how large, and the evidence.

    held_out: runs used neither for the fit nor for the selection; by default the doublets among `runs`.
    baseline: the model to test, "roll-yaw", "bicycle", "lumped" or "kinematic"; by default "roll-yaw", or
    the simpler one of "bicycle" and "kinematic" if the runs do not determine roll or tyres. model: an
    identification.json with the baseline and its parameters. simulated: recordings of a simulation with the
    same steering as `runs`, whose model becomes the baseline. only, without: ids of effects to try, or to
    exclude. time_limit [s]; stop: returns True to end; both end with the results so far. progress(activity,
    share done 0..1). seed: of the bootstrap. UsageError for invalid arguments; refused data give the verdict
    "refused".

    Here with two candidates only, to be quick; without `only` it tries all effects:

    >>> worn = rs.read("worn/run2.BIN", "worn/run4.BIN", vehicle="worn/rover.toml")
    >>> found = rs.diagnose(worn, only=["steering_backlash", "servo_lag"])
    >>> found.verdict, [f.effect for f in found.findings], found.held_out_runs
    ('explained', ['steering_backlash'], ('run4',))
    >>> gap = found.findings[0].parameters["b"]
    >>> f"half gap {gap.value:.2f} {gap.unit}, 90 %: {gap.low:.2f} to {gap.high:.2f}"
    'half gap 0.01 rad, 90 %: 0.01 to 0.01'
    """
    if not isinstance(runs, Runs):
        kind = type(runs).__name__
        raise UsageError(f'the first argument ({kind}) must be runs: rs.read(..., vehicle="rover.toml")')
    if runs.vehicle is None:
        raise UsageError('the vehicle is not known: rs.read(..., vehicle="rover.toml")')
    if not len(runs):
        raise UsageError("there is no run to diagnose")
    if baseline is not None and baseline not in BASELINES:
        raise UsageError(f"there is no baseline {baseline!r}; choose from {', '.join(BASELINES)}")
    if model is not None and simulated:
        raise UsageError("model and simulated both give a baseline; give only one of them")
    limit = time_limit_of(time_limit)
    for role, some in (("held_out", held_out), ("simulated", simulated)):
        if not isinstance(some, Sequence) or not all(isinstance(run, Recording) for run in some):
            raise UsageError(f"{role} ({type(some).__name__}) must be a sequence of runs; give rs.read(...)")
    name, values = nominal_of(Path(model), baseline) if model is not None else (baseline, {})
    chosen, left_out = candidates_left(_listed(only), _listed(without), None if simulated else name)
    settings = DiagnosisSettings(name, chosen, left_out, limit, seed, values)
    given = material(runs, held_out, simulated)
    found = diagnosed(given, runs.vehicle, settings, progress, stop)
    made = provenance(runs.vehicle, runs.vehicle_file, given.held_out, "", datetime.now().astimezone())
    return _full(found, given.origin(made, settings))


def _full(found: Diagnosis, origin: DiagnosisOrigin) -> FullDiagnosis:
    own = {f.name: getattr(found, f.name) for f in fields(found)}
    return FullDiagnosis(**own, origin=origin)


def load_diagnosis(path: Location) -> FullDiagnosis:
    """The diagnosis that `FullDiagnosis.save` wrote, or the diagnosis.json of a report (or its folder).

    The latter has neither recordings nor the curves of the pictures. UsageError for any other file.

    >>> rs.load_diagnosis(found.save("diagnosis.json")).findings[0].effect
    'steering_backlash'
    """
    from rover_sweep.api.save import loads, text_of
    from rover_sweep.report.diagnosis.diagnosis_json import read_diagnosis
    from rover_sweep.report.export.augmented_model_json import refuse_implausible

    path = Path(path) / "diagnosis.json" if Path(path).is_dir() else Path(path)
    text = text_of(path)
    with suppress(ValueError):
        document = read_json(text)
        if isinstance(document, dict) and document.get("format") == "rover-sweep diagnosis":
            return _full(read_diagnosis(path), DiagnosisOrigin())
    found = loads(text, str(path))
    if not isinstance(found, FullDiagnosis):
        raise UsageError(f"{path} holds a {type(found).__name__}, not a diagnosis")
    if found.model is not None:
        try:
            refuse_implausible(found.model)
        except (ValueError, TypeError, AttributeError) as error:
            raise UsageError(f"{path} is damaged ({error}); diagnose again") from error
    return found


def _listed(names: Sequence[str]) -> tuple[str, ...]:
    """A single id counts as a list of one."""
    return (names,) if isinstance(names, str) else tuple(names)


HALF = 0.5  # probability of something without a name, from which none is given


def compare(
    runs: Runs,
    simulated: Sequence[Recording],
    held_out: Sequence[Recording] = (),
    *,
    diagnosis: Diagnosis | None = None,
    effects: Sequence[str] | None = None,
    seed: int = 1,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
) -> Comparison:
    """Compare a simulation with the recordings whose steering and speed drove it.

    simulated: runs of the simulation, from any simulator, each with the steering of one of `runs` or
    `held_out`. held_out: recorded runs that only check the answer. diagnosis: of `runs`, made if missing.
    effects: names of the laws that the simulation has, where they are known; None searches them.
    UsageError for wrong arguments, DataRefused for runs that cannot be compared.
    """
    if not isinstance(runs, Runs) or runs.vehicle is None:
        raise UsageError(
            'the first argument must be runs with their vehicle: rs.read(..., vehicle="rover.toml")'
        )
    if not len(simulated):
        raise UsageError(
            "there is no simulated run to compare; give rs.read(...) of the simulation's recordings"
        )
    found = diagnosis or diagnose(runs, held_out, seed=seed, progress=progress, stop=stop)
    return compared(
        tuple(runs), tuple(held_out), tuple(simulated), found, effects, seed, progress, stop
    ).answer


def compared(
    runs: Sequence[Recording],
    held_out: Sequence[Recording],
    simulated: Sequence[Recording],
    found: Diagnosis,
    effects: Sequence[str] | None = None,
    seed: int = 1,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
    fitted: dict[tuple[str, ...], FittedSide] | None = None,
    measured: Known = MappingProxyType({}),
    changed: Collection[str] = (),
) -> Compared:
    """`compare` with the data for pictures and corrections. DataRefused where the recordings were refused.

    fitted, measured, changed: as in `rover_sweep.comparison.compare`.
    """
    if found.model is None:
        raise DataRefused(f"the recordings cannot be compared with a simulation: {found.sentence}")
    used = [*(experiment(run) for run in runs), *(experiment(run) for run in held_out)]
    ordered = in_order(used)
    return sides_compared(
        ordered[: len(runs)],
        ordered[len(runs) :],
        in_order([experiment(run) for run in simulated]),
        found.model,
        effects,
        seed,
        progress or (lambda what, share: None),
        stop or (lambda: False),
        fitted,
        (found.p_else or 0.0) >= HALF,
        measured,
        changed,
    )
