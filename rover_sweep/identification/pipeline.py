"""From runs to models: responses, fits, what the instruments did to them, verification, verdicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from threadpoolctl import threadpool_limits

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Recording
from rover_sweep.data.result_table import ShortTable, Shown, band_words
from rover_sweep.identification.bootstrap.model_intervals import with_intervals
from rover_sweep.identification.grouping import MODELS, Group, Settings, grouped
from rover_sweep.identification.handling import Handling, handling, has_handling
from rover_sweep.identification.imu_place import wrong_place
from rover_sweep.identification.model_results import (
    UNTIED,
    ModelResult,
    NotPossible,
    Work,
    model_result,
    physical_result,
    tyres_unseen,
)
from rover_sweep.identification.models.kinematic import kinematic
from rover_sweep.identification.own_structure import own_result
from rover_sweep.identification.recommendation import recommendation
from rover_sweep.identification.structure.state_space import ModelStructure
from rover_sweep.identification.verdicts import ModelVerdict, not_good
from rover_sweep.quality.coherence import CoherenceVerdict, assess, input_responses
from rover_sweep.quality.doubts import doubts
from rover_sweep.quality.faults import spoiling
from rover_sweep.quality.length import each_with_length, too_short, with_length
from rover_sweep.quality.rovers import TWO_ROVERS, with_rovers
from rover_sweep.spectra.conditioned import moving

PLACED = ("roll-yaw", "bicycle", "lumped")  # models that hold the IMU's place


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Shown):
    """Everything that was found. recommended: the model to use, with `summary` saying why.

    refused: models that these runs or this vehicle cannot carry, with the reason. The kinematic
    model is always among `models`, to tell whether tyres show in the data at all.
    """

    geometry: Geometry
    settings: Settings
    groups: tuple[Group, ...]
    coherence: tuple[CoherenceVerdict, ...]
    models: Mapping[str, ModelResult]
    refused: Mapping[str, str]
    recommended: str | None
    summary: tuple[str, ...]

    @property
    def speed(self) -> float:
        """Speed of the first group, m/s."""
        return self.groups[0].speed

    @property
    def handling(self) -> dict[str, Handling]:
        """Handling quantities of the models that have tyres and are identified, by name of the model.

        Also of the fit with a stiffness for each axle, as "<model>, Cf and Cr free".
        """
        fits = {
            f"{name}{label}": fit
            for name, m in self.models.items()
            if m.verdict.level != "not identifiable" and has_handling(m.fit.structure)
            for label, fit in (("", m.fit), (f", {UNTIED}", m.variants.get(UNTIED)))
            if fit is not None
        }
        return {name: handling(fit) for name, fit in fits.items()}

    def table(self) -> ShortTable:
        """A row for each model; the usable bands, what was refused, which model to use."""
        rows = tuple(
            (name, m.verdict.level, f"{m.fit.average:.1f}", *_checked(m)) for name, m in self.models.items()
        )
        bands = (
            f"at {g.speed:.2f} m/s, usable bands in rad/s: "
            + ", ".join(f"{o} {band_words(f.band)}" for o, f in g.responses.items())
            for g in self.groups
        )
        refused = (f"{name} refused: {why}" for name, why in self.refused.items())
        return ShortTable(
            f"identification from {sum(len(g.runs) for g in self.groups)} run(s)",
            ("model", "verdict", "J_ave", "J_rms", "TIC"),
            rows,
            (*bands, *refused, *self.summary),
        )


def _checked(model: ModelResult) -> tuple[str, str]:
    """J_rms and TIC on the first run of the verification."""
    first = model.verification[:1]
    return (f"{first[0].j_rms:.2f}", f"{first[0].tic:.3f}") if first else ("-", "-")


@threadpool_limits.wrap(limits=1, user_api="blas")  # small matrices: threads cost more than they bring
def identify(
    runs: Sequence[Recording],
    geometry: Geometry,
    verify_on: Sequence[Recording] = (),
    settings: Settings | None = None,
    structures: Sequence[ModelStructure] = (),
) -> Identification:
    """Identifies the asked models from runs that have `delta`, and verifies them on other runs.

    structures: a user's own, fitted beside them under their names. Runs that cannot carry a model give a
    verdict with the reason, not an exception. ValueError for a structure named as another model.
    """
    wanted = settings or Settings()
    _refuse_same_names([s.name for s in structures])
    together = with_rovers((*runs, *verify_on))
    runs, verify_on = together[: len(runs)], together[len(runs) :]
    quality = tuple(_assessed(run, wanted.condition_on) for run in each_with_length(runs))
    groups = grouped(runs, wanted)
    reasons = {i: why for i, g in enumerate(groups) if (why := g.why_not())}
    said = tuple(dict.fromkeys(words for g in groups for words in g.remarks))
    if len(reasons) == len(groups):
        stops = (*_short(runs, wanted), *dict.fromkeys(reasons.values()))
        refused = dict.fromkeys((*wanted.models, *(s.name for s in structures)), stops[0])
        return Identification(geometry, wanted, groups, quality, {}, refused, None, (*stops, *said))
    said = (*(_left_out(groups[i], why) for i, why in reasons.items()), *said)
    groups = tuple(g for i, g in enumerate(groups) if i not in reasons)
    work = Work(groups, geometry, tuple(verify_on), wanted)
    models, refused = _fitted(work, structures)
    models = with_intervals(models, groups, wanted)
    if doubted := doubts(runs):
        models = {n: replace(m, verdict=not_good(m.verdict, doubted)) for n, m in models.items()}
    too_much = tyres_unseen(models)
    if too_much:
        models = {n: m if n == "kinematic" else _doubted(m, too_much) for n, m in models.items()}
    models, spoilt = _judged_by_data(
        models, (*_long_enough(groups, wanted), *_of_another(verify_on)), wanted, _misplaced(models, work)
    )
    best, words = recommendation(models, geometry.wheelbase, too_much, spoilt)
    return Identification(geometry, wanted, groups, quality, models, refused, best, (*words, *said))


def _runs(groups: Sequence[Group]) -> tuple[Recording, ...]:
    return tuple(run for group in groups for run in group.runs)


def _long_enough(groups: Sequence[Group], settings: Settings) -> tuple[Recording, ...]:
    """The runs of the groups, with a fault where they are too short together."""
    return with_length(_runs(groups), *(settings.band or ())[:1])


def _short(runs: Sequence[Recording], settings: Settings) -> tuple[str, ...]:
    """What to say first where nothing can be identified because the runs are short."""
    fault = too_short(runs, *(settings.band or ())[:1])
    return (f"nothing can be identified: {fault.text}",) if fault else ()


def _of_another(runs: Sequence[Recording]) -> tuple[Recording, ...]:
    """The runs that are of another rover."""
    return tuple(run for run in runs if any(note.fault == TWO_ROVERS for note in run.notes))


def _misplaced(models: Mapping[str, ModelResult], work: Work) -> str:
    """What the richest model with a place of the IMU says of it."""
    name = next((n for n in PLACED[:2] if n in models), "")
    return wrong_place(models[name].fit, work.conditions(), work.geometry) if name else ""


def _judged_by_data(
    models: Mapping[str, ModelResult], runs: Sequence[Recording], settings: Settings, misplaced: str
) -> tuple[dict[str, ModelResult], tuple[str, ...]]:
    """(models, those made from spoilt channels no longer good; what is wrong with the channels).

    misplaced: what is wrong with the IMU's place, '' for nothing.
    """
    why = {
        name: spoiling(runs, [o for o in settings.fitted if o in m.fit.structure.outputs])
        for name, m in models.items()
    }
    if misplaced:
        why = {n: (misplaced, *found) if n in PLACED else found for n, found in why.items()}
    judged = {name: m.spoilt(why[name]) if why[name] else m for name, m in models.items()}
    return judged, tuple(dict.fromkeys(words for found in why.values() for words in found))


def _left_out(group: Group, why: str) -> str:
    return f"left out {', '.join(run.name for run in group.runs)} at {group.speed:.2f} m/s: {why}"


def _assessed(run: Recording, condition_on: Sequence[str]) -> CoherenceVerdict:
    """The verdict on one run, by its partial coherences where another input moves."""
    others = tuple(c for c in condition_on if moving([run], c))
    return assess(run, input_responses([run], ("delta", *others))["delta"] if others else None)


def _refuse_same_names(names: Sequence[str]) -> None:
    taken = [n for i, n in enumerate(names) if n in (*MODELS, "kinematic") or n in names[:i]]
    if taken:
        raise ValueError(f"there is another model named {taken[0]!r}; give the structure another name")


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


def _doubted(result: ModelResult, why: str) -> ModelResult:
    return replace(result, verdict=ModelVerdict("not identifiable", (why, *result.verdict.sentences)))
