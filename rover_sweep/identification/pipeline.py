"""From runs to models: responses, fits, faults of the data, verification, verdicts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import isfinite

from threadpoolctl import threadpool_limits

from rover_sweep.data.by_name import ByName
from rover_sweep.data.geometry import Geometry
from rover_sweep.data.plain_values import PlainNumbers
from rover_sweep.data.plausibility import implausible
from rover_sweep.data.recording import Recording
from rover_sweep.data.result_table import ShortTable, Shown, band_words
from rover_sweep.identification.bootstrap.model_intervals import with_intervals
from rover_sweep.identification.fit import Estimate
from rover_sweep.identification.grouping import MODELS, Group, Settings, grouped
from rover_sweep.identification.handling import Handling, gain_error, handling, has_handling
from rover_sweep.identification.imu_place import wrong_place
from rover_sweep.identification.model_results import (
    TIED,
    UNTIED,
    ModelResult,
    NotPossible,
    Work,
    model_result,
    physical_result,
    tyres_not_identifiable,
)
from rover_sweep.identification.models.kinematic import kinematic
from rover_sweep.identification.models.steering_lag import refitted_with_lag
from rover_sweep.identification.own_structure import own_result
from rover_sweep.identification.recommendation import PHYSICAL, recommendation, wrong_wheelbase
from rover_sweep.identification.structure.state_space import ModelStructure
from rover_sweep.identification.verdicts import ModelVerdict, at_most_acceptable
from rover_sweep.quality.coherence import CoherenceTable, CoherenceVerdict, assess, input_responses
from rover_sweep.quality.doubts import doubts
from rover_sweep.quality.faults import fault_sentences, without_faulty
from rover_sweep.quality.length import each_with_length, too_short, with_length
from rover_sweep.quality.rovers import TWO_ROVERS, with_rovers
from rover_sweep.spectra.conditioned import moving

OF_FILE = ("roll-yaw", "bicycle", "lumped")  # models that depend on masses, inertias and the IMU's position


@dataclass(frozen=True, eq=False, repr=False)
class Identification(PlainNumbers, Shown):
    """The result of an identification. recommended: name of the model to use; summary: reasons, as sentences.

    coherence: a verdict for each run. refused: {model that could not be identified: reason}. `models` always
    has the kinematic model, which shows whether the data hold any effect of the tyres. numbers: of the rover,
    with errors of the vehicle file and normal tolerances allowed for, where they were asked for and a model
    with tyres fits; those of `models` are of a fit of the responses alone, as CIFER's.
    """

    geometry: Geometry
    settings: Settings
    groups: tuple[Group, ...]
    coherence: tuple[CoherenceVerdict, ...]
    models: Mapping[str, ModelResult]
    refused: Mapping[str, str]
    recommended: str | None
    summary: tuple[str, ...]
    numbers: ByName[Estimate] = field(default_factory=ByName)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "coherence", CoherenceTable(self.coherence))

    @property
    def speed(self) -> float:
        """Speed of the first group, m/s."""
        return self.groups[0].speed

    @cached_property
    def handling(self) -> dict[str, Handling]:
        """{model: handling quantities} of the identified models with tyres.

        Also of the fits with one stiffness for each axle, "<model>, Cf and Cr free", and, where that is the
        model itself, "<model>, one C for both axles". Fits with both axles free are refitted with a lag of
        the steering: with a delay alone, the gain that a servo loses lowers Cf and the yaw frequency.
        """
        fits = {
            f"{name}{label}": fit
            for name, m in self.models.items()
            if m.verdict.level != "not identifiable" and has_handling(m.fit.structure)
            for label, fit in (("", m.fit), *((f", {v}", m.variants.get(v)) for v in (UNTIED, TIED)))
            if fit is not None
        }
        error = gain_error(_runs(self.groups))
        conditions = [g.condition(self.settings.fitted) for g in self.groups]
        lagged = {
            id(fit): refitted_with_lag(fit, conditions)
            for fit in fits.values()
            if "Cf" in fit.structure.values
        }
        found = {name: handling(lagged.get(id(fit), fit), error=error) for name, fit in fits.items()}
        for name in (f"{self.recommended}, {UNTIED}", self.recommended):
            if name in found and "K_us" in self.numbers:
                known = self.numbers["K_us"], self.geometry.wheelbase
                return found | {name: found[name].with_understeer(*known)}
        return found

    def table(self) -> ShortTable:
        """A row for each model; usable bands, refused models, the recommendation."""
        rows = tuple(
            (name, m.verdict.level, f"{m.fit.average:.1f}", *_verified(m)) for name, m in self.models.items()
        )
        bands = (
            f"at {g.speed:.2f} m/s, usable bands in rad/s: "
            + ", ".join(f"{o} {band_words(f.band)}" for o, f in g.responses.items())
            for g in self.groups
        )
        refused = (f"{name} refused: {why}" for name, why in self.refused.items())
        runs = sum(len(g.runs) for g in self.groups)
        return ShortTable(
            f"identification from {runs} run{'s' if runs != 1 else ''}",
            ("model", "verdict", "J_ave", "J_rms", "TIC"),
            rows,
            (*bands, *refused, *self.summary),
        )


def _verified(model: ModelResult) -> tuple[str, str]:
    """J_rms and TIC on the first verification run."""
    first = model.verification[:1]
    return (f"{first[0].j_rms:.2f}", f"{first[0].tic:.3f}") if first else ("-", "-")


@threadpool_limits.wrap(limits=1, user_api="blas")  # small matrices: threads cost more than they bring
def identify(
    runs: Sequence[Recording],
    geometry: Geometry,
    verify_on: Sequence[Recording] = (),
    settings: Settings | None = None,
    structures: Sequence[ModelStructure] = (),
    fitted: Callable[[Mapping[str, ModelResult]], None] | None = None,
) -> Identification:
    """Identifies models from runs that have `delta`, and verifies them on the runs of verify_on.

    structures: a user's own models, fitted in addition. fitted: called with the models as soon as they are
    fitted; the intervals take longer. A model that the runs do not support is refused with the reason,
    without an exception. ValueError when two models have one name.
    """
    wanted = settings or Settings()
    _refuse_same_names([s.name for s in structures])
    together = with_rovers((*runs, *verify_on))
    runs, verify_on = together[: len(runs)], together[len(runs) :]
    quality = tuple(_assessed(run, wanted.condition_on) for run in each_with_length(runs))
    runs, verify_on, apart = without_faulty(runs, verify_on, wanted.fitted)
    groups = grouped(runs, wanted)
    reasons = {i: why for i, g in enumerate(groups) if (why := g.why_not())}
    remarks = (*apart, *dict.fromkeys(sentences for g in groups for sentences in g.remarks))
    if len(reasons) == len(groups):
        stops = (*_short(runs, wanted), *dict.fromkeys(reasons.values()))
        refused = dict.fromkeys((*wanted.models, *(s.name for s in structures)), stops[0])
        return Identification(geometry, wanted, groups, quality, {}, refused, None, (*stops, *remarks))
    remarks = (*(_left_out(groups[i], why) for i, why in reasons.items()), *remarks)
    groups = tuple(g for i, g in enumerate(groups) if i not in reasons)
    work = Work(groups, geometry, tuple(verify_on), wanted)
    models, refused = _fitted(work, structures)
    if fitted is not None:
        fitted(models)
    models = with_intervals(models, groups, wanted, geometry.friction)
    models = {n: m.spoilt(_doubted(m, geometry)) for n, m in models.items()}
    if doubtful := doubts(runs):
        models = {n: replace(m, verdict=at_most_acceptable(m.verdict, doubtful)) for n, m in models.items()}
    no_tyres = tyres_not_identifiable(models)
    if no_tyres:
        models = {n: m if n == "kinematic" else _not_identifiable(m, no_tyres) for n, m in models.items()}
    models, faults = _judged_by_data(
        models,
        (*_long_enough(groups, wanted), *_from_another_rover(verify_on)),
        wanted,
        (
            *implausible(geometry),
            *wrong_wheelbase(models["kinematic"], geometry.wheelbase),
            *filter(None, (_imu_fault(models, work),)),
        ),
    )
    best, sentences = recommendation(models, no_tyres, faults)
    return Identification(geometry, wanted, groups, quality, models, refused, best, (*sentences, *remarks))


def _runs(groups: Sequence[Group]) -> tuple[Recording, ...]:
    return tuple(run for group in groups for run in group.runs)


def _long_enough(groups: Sequence[Group], settings: Settings) -> tuple[Recording, ...]:
    """The runs of the groups, with a fault when they are too short in total."""
    return with_length(_runs(groups), *(settings.band or ())[:1])


def _short(runs: Sequence[Recording], settings: Settings) -> tuple[str, ...]:
    """The first sentence when the runs are too short to identify anything."""
    fault = too_short(runs, *(settings.band or ())[:1])
    return (f"nothing can be identified: {fault.text}",) if fault else ()


def _from_another_rover(runs: Sequence[Recording]) -> tuple[Recording, ...]:
    """The runs that were driven with another rover."""
    return tuple(run for run in runs if any(note.fault == TWO_ROVERS for note in run.notes))


def _doubted(model: ModelResult, geometry: Geometry) -> tuple[str, ...]:
    """Why the numbers of a fit cannot be used: implausible, or without intervals that were asked for."""
    free = [e for e in model.fit.estimates if e.free]
    physical = model.fit.structure.name in PHYSICAL and model.verdict.level != "not identifiable"
    absurd = implausible(geometry, {e.name: e.value for e in free}) if physical else ()
    lost = [e.name for e in free if e.interval and not isfinite(e.interval.low + e.interval.high)]
    none = f"no interval of {', '.join(lost)}: more than half of the bootstrap's fits failed"
    return (*absurd, *((none,) if lost else ()))


def _imu_fault(models: Mapping[str, ModelResult], work: Work) -> str:
    """A sentence on a wrong sign of the IMU's position, from the roll-yaw or else the bicycle model."""
    name = next((n for n in OF_FILE[:2] if n in models), "")
    return wrong_place(models[name].fit, work.conditions(), work.geometry) if name else ""


def _judged_by_data(
    models: Mapping[str, ModelResult], runs: Sequence[Recording], settings: Settings, of_file: tuple[str, ...]
) -> tuple[dict[str, ModelResult], tuple[str, ...]]:
    """(models, poor at best where their channels are faulty; sentences on the faults).

    of_file: sentences on the numbers of the vehicle file.
    """
    why = {
        name: fault_sentences(runs, [o for o in settings.fitted if o in m.fit.structure.outputs])
        for name, m in models.items()
    }
    why = {n: (*of_file, *found) if n in OF_FILE else found for n, found in why.items()}
    judged = {name: m.spoilt(why[name]) for name, m in models.items()}
    return judged, tuple(dict.fromkeys(sentences for found in why.values() for sentences in found))


def _left_out(group: Group, why: str) -> str:
    return f"left out {', '.join(run.name for run in group.runs)} at {group.speed:.2f} m/s: {why}"


def _assessed(run: Recording, condition_on: Sequence[str]) -> CoherenceVerdict:
    """The coherence verdict on one run, from partial coherences where another input moves."""
    others = tuple(c for c in condition_on if moving([run], c))
    return assess(run, input_responses([run], ("delta", *others))["delta"] if others else None)


def _refuse_same_names(names: Sequence[str]) -> None:
    taken = [n for i, n in enumerate(names) if n in (*MODELS, "kinematic") or n in names[:i]]
    if taken:
        raise ValueError(f"a model named {taken[0]!r} exists already; rename the structure")


def _fitted(
    work: Work, structures: Sequence[ModelStructure]
) -> tuple[dict[str, ModelResult], dict[str, str]]:
    models = {"kinematic": physical_result(kinematic(work.geometry), work)}
    refused: dict[str, str] = {}
    wanted = {name: partial(model_result, name, work) for name in work.settings.models}
    for name, result in (wanted | {s.name: partial(own_result, s, work) for s in structures}).items():
        try:
            models[name] = result()
        except NotPossible as reason:
            refused[name] = str(reason)
    return models, refused


def _not_identifiable(result: ModelResult, why: str) -> ModelResult:
    return replace(result, verdict=ModelVerdict("not identifiable", (why, *result.verdict.sentences)))
