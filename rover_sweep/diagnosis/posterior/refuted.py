"""Takes out the names that held-out runs refute: an effect must improve runs that the fit did not use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rover_sweep.diagnosis.held_out.worth import FittedModel, HeldOutRun, refitted_without, worse_by
from rover_sweep.diagnosis.posterior.infer import Inference
from rover_sweep.diagnosis.posterior.model_fit import ModelFit
from rover_sweep.diagnosis.problem.least_squares import fit, sensitivities
from rover_sweep.diagnosis.simulation.experiment import Experiment

Judged = tuple[Inference, tuple[HeldOutRun, ...], Mapping[str, FittedModel], Mapping[str, float]]


def without_refuted(found: Inference, held: Sequence[Experiment]) -> Judged:
    """(the inference without refuted names, held-out runs, {name: model without it}, {refuted: probability}).

    An effect is refuted where the held-out runs together are predicted worse with it than by the other
    effects refitted, beyond the noise. What it explains in the runs has another cause, so the explanations
    with it count as something else. The worst one goes first, as the others may be right without it.
    """
    refuted: dict[str, float] = {}
    while True:
        last, whole = found.last, nearest_fit(found.last)
        runs = tuple(HeldOutRun.of(run, last.problem.floor, whole) for run in held)
        names = [named.law.id for named in found.named]
        rests = {name: _without(name, found, whole) for name in names} if held else {}
        worse = {name: _worse_by(runs, rest, whole) for name, rest in rests.items()}
        worst = max(worse, key=lambda name: worse[name], default="")
        if not worst or worse[worst] <= 0.0:
            return found, runs, rests, refuted
        refuted[worst] = found.posterior.effects.get(worst, 0.0)
        found = _taken_out(worst, found, rests[worst])


def nearest_fit(last: ModelFit) -> FittedModel:
    """The fit nearest to the recordings: a model alone, without a rover's tolerances, predicts a run."""
    return FittedModel(last.model, last.closest.x)


def _without(effect: str, found: Inference, whole: FittedModel) -> FittedModel:
    if set(whole.model.ids) == {effect}:
        return nearest_fit(found.none)
    return refitted_without(effect, found.last.problem.plain, whole)


def _worse_by(runs: Sequence[HeldOutRun], rest: FittedModel, whole: FittedModel) -> float:
    before, after = (np.concatenate([run.residual(m) for run in runs]) for m in (rest, whole))
    return worse_by(before, after)


def _taken_out(effect: str, found: Inference, rest: FittedModel) -> Inference:
    last, problem = found.none, found.last.problem
    if rest.model.effects:
        fitted = fit(problem, rest.model.structure, rest.model.free, rest.x)
        last = found.none.with_explanation(rest.model, sensitivities(problem, fitted))
    kept = tuple(named for named in found.named if named.law.id != effect)
    return replace(found, last=last, posterior=found.posterior.without(effect), named=kept, families=())
