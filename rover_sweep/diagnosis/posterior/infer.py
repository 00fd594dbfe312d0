"""From runs to the probabilities of explanations: fit, explore, weigh, and the model of the answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rover_sweep.data.geometry import Geometry, Tolerances
from rover_sweep.data.recording import Array
from rover_sweep.data.results import Progress
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.held_out import HeldOutRun, scaled_floor, worse_by
from rover_sweep.diagnosis.posterior.explanations import explored, refitted
from rover_sweep.diagnosis.posterior.model_fit import ModelFit, fit_with_floor, in_metric_of, model_fit
from rover_sweep.diagnosis.posterior.unnamed import UnnamedFamily, families, held_out_costs
from rover_sweep.diagnosis.posterior.weights import (
    ELSE,
    POWER,
    ExplanationEvidence,
    Posterior,
    SomethingElse,
    coarsened,
    evidence_of,
    posterior,
)
from rover_sweep.diagnosis.problem.least_squares import COARSE, Fitted, cost_of, fit
from rover_sweep.diagnosis.problem.residuals import Problem, never, with_floor
from rover_sweep.diagnosis.result import Baseline
from rover_sweep.diagnosis.simulation.candidates import Model, has_roll, possible
from rover_sweep.diagnosis.simulation.experiment import Experiment

SURE = 0.8
"""Probability from which an effect is named, or together one of a few."""
FEW = 3  # most effects that one of a few lists
SHARE = 0.1  # least probability of an effect that is listed, or one of a few
LIKELY = 6  # families without a name that held-out runs judge


@dataclass(frozen=True, eq=False)
class Options:
    """Settings of an inference. only, without: ids of effects.

    progress(activity, share done 0..1); stop: True ends the search.
    """

    only: tuple[str, ...]
    without: tuple[str, ...]
    progress: Progress
    stop: Callable[[], bool]


@dataclass(frozen=True, eq=False)
class Named:
    """An effect of the answer. law: its form. probability: that it is present and matters.

    alternatives: {effect: probability} of those that share the evidence, if none alone is sure. gain: drop of
    the cost by it when the other effects are kept.
    """

    law: Effect
    probability: float
    alternatives: Mapping[str, float]
    gain: float


@dataclass(frozen=True, eq=False)
class Inference:
    """none: the baseline alone; last: the model of the answer, in the same metric.

    named: its effects that are answers. minor: its effects that are present and do not matter.
    families: unnamed, in the residual of `last`, () if not known. gains: {effect: drop of the cost with it
    alone}. held: the held-out runs in the metric, in which they weighed the explanations.
    """

    none: ModelFit
    last: ModelFit
    posterior: Posterior
    named: tuple[Named, ...]
    minor: tuple[str, ...]
    families: tuple[UnnamedFamily, ...]
    gains: Mapping[str, float]
    held: tuple[Problem, ...] = ()
    stopped: bool = False


@dataclass(frozen=True, eq=False)
class Explored:
    """The explanations of some runs and their evidence. pool, evidence: in the same order.

    gains: {effect: drop of the cost with it alone}, of all fitted effects, also those whose fit was not
    continued.
    """

    none: ModelFit
    pool: tuple[Fitted, ...]
    gains: Mapping[str, float]
    evidence: tuple[ExplanationEvidence, ...]
    held: tuple[Problem, ...]
    families: Mapping[frozenset[str], tuple[UnnamedFamily, ...]] = field(default_factory=dict)
    """Unnamed, in the residual of the explanation with these effects; largest evidence first."""
    others: tuple[SomethingElse, ...] = ()

    @property
    def held_rows(self) -> int:
        """Number of held-out rows."""
        return sum(p.size for p in self.held)

    def of(self, effects: frozenset[str]) -> Fitted:
        """The explanation with these effects."""
        return next(e for e in self.pool if e.effects == effects)

    @property
    def posterior(self) -> Posterior:
        """The probability of each."""
        return posterior(self.evidence, self.held_rows, self.others)


def explore(
    runs: Sequence[Experiment],
    model: Model,
    start: Mapping[str, float],
    options: Options,
    held: Sequence[Experiment] = (),
) -> Explored:
    """The explanations of a model's residual; the arguments are those of `infer`."""
    options.progress("fitting the model", 0.0)
    model = replace(model, given=frozenset(model.ids))
    none = model_fit(runs, model, start, options.only, options.without)
    effects = possible(model, runs, options.only, options.without)[0]
    searched = replace(none.problem, stop=options.stop)
    tried: dict[frozenset[str], tuple[UnnamedFamily, ...]] = {}

    def nearer(one: Fitted) -> tuple[Problem, Fitted, Fitted]:
        plain, closest = fit_with_floor(runs, one.model, one.x)
        there = replace(in_metric_of(plain, closest), stop=options.stop)
        near = fit(there, one.model, closest.x)
        return there, fit(there, model, near.x), near

    def unnamed(problem: Problem, first: Fitted) -> float:
        variance = COARSE * first.overdispersion
        tried[first.effects] = _families(problem, first, variance)
        return ELSE + POWER * tried[first.effects][0].evidence(variance)

    problem, made_at, every = explored(
        searched, none.fitted, none.closest, effects, nearer, unnamed, options.progress
    )
    pool = tuple(every)
    without_effects = next(e for e in pool if not e.effects)
    moved = problem.floor is not none.problem.floor
    closest = fit(problem.plain, model, none.closest.x) if moved and not options.stop() else none.closest
    none = replace(none, problem=replace(problem, stop=never), closest=closest, fitted=without_effects)
    alone = {next(iter(e.effects)): none.fitted.cost - e.cost for e in every if len(e.effects) == 1}
    options.progress("weighing the explanations", 0.85)
    judged = tuple(_held_out(run, none, made_at) for run in held)
    costs = [sum(cost_of(p, e) for p in judged) for e in pool]
    length = float(none.problem.runs[0].t[-1])
    evidence = tuple(evidence_of(e, c, length, len(runs)) for e, c in zip(pool, costs, strict=True))
    found = Explored(none, pool, {e: max(gain, 0.0) for e, gain in alone.items()}, evidence, judged)
    if options.stop():
        return found
    options.progress("testing unnamed causes", 0.88)
    variance = coarsened(evidence)
    for ids in (frozenset[str](), found.posterior.weighed[0].effects):
        if ids not in tried:
            tried[ids] = _families(none.problem, found.of(ids), variance)
    found = replace(found, families=tried)
    return replace(found, others=tuple(_something_else(found, ids) for ids in tried))


def infer(
    runs: Sequence[Experiment],
    model: Model,
    start: Mapping[str, float],
    options: Options,
    held: Sequence[Experiment] = (),
) -> Inference:
    """The probabilities of all explanations of a model's residual, and the answer.

    start: {coordinate: value} to begin the first fit from. held: runs to which nothing is fitted; they weigh
    the explanations. If options.stop is true it ends with the results so far.
    """
    found = explore(runs, model, start, options, held)
    weighed, none = found.posterior, found.none
    named = _named(weighed)
    whole = _whole(found, weighed, named)
    last = none.with_explanation(whole) if whole.effects else none
    return Inference(
        none,
        last,
        weighed,
        tuple(_of(found, last, weighed, effect, others) for effect, others in named),
        tuple(sorted(whole.effects - {n for n, _ in named})),
        found.families.get(whole.effects, ()),
        found.gains,
        found.held,
        options.stop(),
    )


def _families(problem: Problem, e: Fitted, variance: float) -> tuple[UnnamedFamily, ...]:
    """The families in an explanation's residual, the largest evidence first."""
    return tuple(sorted(families(problem, e), key=lambda f: -f.evidence(variance)))


def _something_else(found: Explored, effects: frozenset[str]) -> SomethingElse:
    """The families with the most evidence in an explanation's residual, and their held-out costs."""
    likely = found.families[effects][:LIKELY]
    changes = np.zeros(len(likely))
    for run in found.held:
        before, after = held_out_costs(run, found.of(effects), likely, coarsened(found.evidence))
        changes += np.array(after) - before
    return SomethingElse(effects, likely, changes)


def _held_out(run: Experiment, none: ModelFit, made_at: Fitted) -> Problem:
    """A held-out run as a problem in the metric of the tolerances."""
    floor = scaled_floor(run, none.problem.floor, none.closest)
    return in_metric_of(with_floor([run], floor), made_at)


def _named(weighed: Posterior) -> list[tuple[str, dict[str, float]]]:
    """(effect, {alternative: probability}) of those that are sure, or sure to be one of a few."""
    found = weighed.effects
    sure: list[tuple[str, dict[str, float]]] = [(e, {}) for e, p in found.items() if p >= SURE]
    kept = {e for e, _ in sure}
    rivals: dict[str, float] = {}
    for one in weighed.weighed:
        others = one.named - kept
        if kept <= one.named and len(others) == 1:
            (effect,) = others
            rivals[effect] = rivals.get(effect, 0.0) + one.probability * one.matters[effect]
    few = sorted(((p, e) for e, p in rivals.items() if p >= SHARE), reverse=True)[:FEW]
    if len(few) > 1 and sum(p for p, _ in few) >= SURE:
        sure.append((few[0][1], {e: p for p, e in few[1:]}))
    return sure


def _whole(found: Explored, weighed: Posterior, named: Sequence[tuple[str, object]]) -> Fitted:
    """The most probable explanation with all named effects and no other one that matters."""
    ids = frozenset(e for e, _ in named)
    if not ids:
        return found.of(frozenset())
    fitting = [w.effects for w in weighed.weighed if w.named == ids]
    if fitting:
        return found.of(fitting[0])
    near = found.of(next((w.effects for w in weighed.weighed if ids <= w.named), frozenset()))
    model = near.model
    for extra in near.effects - ids:
        model = model.without(extra)
    for missing in ids - set(model.ids):
        source = next(found.of(w.effects).model for w in weighed.weighed if missing in w.effects)
        name = next(n for n in source.effects if source.law(n).id == missing)
        model = model.with_effect(name, source.happened_in, source.happened_order)
    x = {c.name: near.x.get(c.name, c.start + c.scale) for c in model.free}
    return refitted(found.none.problem, replace(near, model=model, free=model.free, x=x))


def _of(
    found: Explored, last: ModelFit, weighed: Posterior, effect: str, others: Mapping[str, float]
) -> Named:
    """One effect of the answer, with its gain over the others alone."""
    rest = frozenset(last.model.ids) - {effect}
    gain = min(e.cost for e in found.pool if e.effects <= rest) - last.fitted.cost
    law = next(last.model.law(n) for n in last.model.effects if last.model.law(n).id == effect)
    return Named(law, weighed.effects.get(effect, 0.0), dict(others), max(gain, 0.0))


# Which model a simulation follows: the simplest one that fits its recordings.


LADDER: tuple[Baseline, ...] = ("kinematic", "bicycle", "roll-yaw")
EQUAL_COST = 1.3  # factor on the most complex model's cost, up to which a simpler model fits as well


def baseline_of(runs: Sequence[Experiment], rover: Geometry) -> Baseline:
    """The baseline of a simulation, with the noise floor of the most complex model's residual."""
    ladder = LADDER if has_roll(rover) else LADDER[:-1]
    fullest, found = fit_with_floor(runs, Model(ladder[-1], rover, Tolerances()), {})
    problem = with_floor(runs, fullest.floor)
    for baseline in ladder[:-1]:
        model = Model(baseline, rover, Tolerances())
        if fit(problem, model, model.start).data_cost < EQUAL_COST * found.data_cost:
            return baseline
    return ladder[-1]


# Takes out the names that held-out runs refute: an effect must improve runs that the fit did not use.


Judged = tuple[Inference, tuple[HeldOutRun, ...], Mapping[str, Fitted], Mapping[str, float]]


def without_refuted(found: Inference, held: Sequence[Experiment]) -> Judged:
    """(the inference without refuted names, held-out runs, {name: closest model without it}, {refuted:
    probability}).

    An effect is refuted where the held-out runs together are predicted worse with it than by the other
    effects refitted, beyond the noise, in the metric: what a tolerance allows refutes nothing. The residual
    that it explains has another cause, so explanations with it count as something else. The worst one is
    removed first, as the others may be right then.
    """
    refuted: dict[str, float] = {}
    while True:
        last = found.last
        rests = {named.law.id: _without(found, named.law.id) for named in found.named} if held else {}
        worse = {
            name: worse_by(*(_held_rows(found, e) for e in (rest.fitted, last.fitted)))
            for name, rest in rests.items()
        }
        worst = max(worse, key=lambda name: worse[name], default="")
        if not worst or worse[worst] <= 0.0:
            runs = tuple(HeldOutRun.of(run, last.problem.floor, last.closest) for run in held)
            return found, runs, {name: rest.closest for name, rest in rests.items()}, refuted
        refuted[worst] = found.posterior.effects.get(worst, 0.0)
        found = replace(
            found,
            last=rests[worst],
            posterior=found.posterior.without(worst),
            named=tuple(named for named in found.named if named.law.id != worst),
            families=(),
        )


def _without(found: Inference, name: str) -> ModelFit:
    """The model of the answer without one of its effects, refitted."""
    last = found.last
    if set(last.model.ids) - found.none.fitted.model.given == {name}:
        return found.none
    closest = fit(last.problem.plain, last.model.without(name), last.closest.x)
    return replace(last, closest=closest, fitted=fit(last.problem, closest.model, last.fitted.x))


def _held_rows(found: Inference, e: Fitted) -> Array:
    """Residual rows (n,) of all held-out runs, in the metric."""
    return np.concatenate([run.residual(e.model, e.x) for run in found.held])
