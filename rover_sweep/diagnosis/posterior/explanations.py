"""Explanations of a baseline's residual: sets of effects, all fitted in the same problem.

A beam search. Each effect is added to the best explanations so far; its linear prediction (a score test, see
`search`) decides whether it is fitted in the full simulation. All explanations are fitted in one metric with
one noise floor, so that their costs can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rover_sweep.data.results import Progress
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.problem.least_squares import COARSE, Fitted, fit, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem, Stopped
from rover_sweep.diagnosis.search import (
    ASTRAY,
    PER_PARAMETER,
    Screened,
    Tangent,
    fit_from,
    score,
    screen,
    tangent,
)
from rover_sweep.diagnosis.simulation.candidates import DEGREES_OF_FREEDOM, Model
from rover_sweep.spectra.side_by_side import side_by_side

DONE = (0.2, 0.5, 0.7)  # shares of the whole work at which the levels begin, as in typical diagnoses
WIDTH = (10, 4, 2)  # effects that are fitted to an explanation of 0, 1, 2 effects
BEAM = (1, 2, 1)  # explanations of 0, 1, 2 effects that are extended
REFITTED = 7  # explanations of one level that are fitted with their own Jacobian
RIVAL = 0.3  # share of the best gain of a level from which an explanation is fitted on
NEAR = 60.0  # difference of the costs over a row's variance within which it always is
FAR_OFF = 1.5  # mean square of a row from which a fit is far off
WORTH = 6.0  # predicted gain over a row's variance, below which an effect is not fitted
PASSES = 3  # most fresh Jacobians of a fit
CONVERGED = 1.0  # drop of the cost over a row's variance that ends it
BEATEN = 30.0  # ln of odds from which something without a name ends the search
GOES_ON = 12.0  # gain over a row's variance from which one more effect is tried


def explored(
    problem: Problem,
    first: Fitted,
    effects: Sequence[Effect],
    nearer: Callable[[Fitted], tuple[Problem, Fitted]],
    unnamed: Callable[[Problem, Fitted], float],
    progress: Progress = lambda what, share: None,
) -> tuple[Problem, Fitted, list[Fitted]]:
    """(problem, explanation at which its metric was made, all explanations found).

    first: without effects, fitted to the problem, whose metric was made at it. The smallest cost comes first.
    nearer(explanation): the problem in the metric made there, and `first` in it; called if `first` is far off
    and the best single effect is not. unnamed(problem, explanation): ln weight of something unnamed in the
    residual of `first`; if it is far above the best single effect, no further one is tried. If the problem's
    stop is true, the search ends early. progress(activity, share of all the work).
    """
    pool: dict[frozenset[str], Fitted] = {first.effects: first}
    level, alone, made_at = [first], dict[str, Fitted](), first
    for depth, (width, beam) in enumerate(zip(WIDTH, BEAM, strict=True)):
        progress(f"trying {('single effects', 'pairs of effects', 'three effects')[depth]}", DONE[depth])
        try:
            ranked = _next_level(problem, level, beam, width, effects, alone, pool)
            # far off, the rows of a metric that was made at `first` are not those of the rover
            if not depth and ranked and ranked[0].own and _comes_near(first, ranked[0]):
                made_at = ranked[0]
                problem, first = nearer(made_at)
                own = [e for e in ranked if e.own]
                ranked = sorted(side_by_side(partial(_moved, problem, first), own), key=lambda e: e.cost)
                pool, level = {first.effects: first}, [first]
        except Stopped:
            break
        if not alone:
            alone = {next(iter(e.effects - first.effects)): e for e in ranked}
        pool |= {e.effects: e for e in ranked}
        least = min(e.cost for e in level)
        if not ranked or least - ranked[0].cost < GOES_ON * ranked[0].overdispersion:
            break
        # something without a name is far more probable than an effect, whatever is added to that
        gain = (first.cost - ranked[0].cost) / (2.0 * COARSE * ranked[0].overdispersion)
        if not depth and unnamed(problem, first) > gain + BEATEN:
            break
        level = ranked
    pool |= {e.effects: e for e in _missing_parts(problem, pool)}
    return problem, made_at, sorted(pool.values(), key=lambda e: e.cost)


def _missing_parts(problem: Problem, pool: Mapping[frozenset[str], Fitted]) -> list[Fitted]:
    """The best explanation without each of its effects, and the best of these again, where they were not
    found: a larger one must be worth more than its parts."""
    best, missing = min((e for e in pool.values() if e.own), key=lambda e: e.cost), list[Fitted]()
    while len(best.effects) > 1 and not problem.stop():
        parts = [best.effects - {i} for i in sorted(best.effects)]
        known = [pool[p] for p in parts if p in pool and pool[p].own]
        unknown = [p for p in parts if p not in {e.effects for e in known}]
        new = list(side_by_side(partial(_part_of, problem, best), unknown))
        missing += new
        best = min((*known, *new), key=lambda e: e.cost)
    return missing


def _part_of(problem: Problem, whole: Fitted, effects: frozenset[str]) -> Fitted:
    """The explanation with one effect less, fitted from where the whole one is."""
    (effect,) = whole.effects - effects
    model = whole.model.without(effect)
    start = {c.name: whole.x.get(c.name, c.start) for c in model.free}
    known = None if effect in DEGREES_OF_FREEDOM else _without(whole, effect)
    return _converged(problem, fit(problem, model, start, known=known))


def _comes_near(base: Fitted, best: Fitted) -> bool:
    """True if a base is far off and an explanation leaves little of its residual."""
    return base.overdispersion >= FAR_OFF * best.overdispersion


def _next_level(
    problem: Problem,
    level: Sequence[Fitted],
    beam: int,
    width: int,
    effects: Sequence[Effect],
    alone: Mapping[str, Fitted],
    pool: Mapping[frozenset[str], Fitted],
) -> list[Fitted]:
    """The best of a level with one more effect each, the smallest cost first."""
    new: dict[frozenset[str], Fitted] = {}
    for one in sorted(level, key=lambda e: e.cost)[:beam]:
        for more in _extended(problem, one, effects, width, alone, {*pool, *new}):
            new[more.effects] = more
    ranked = sorted(new.values(), key=lambda e: e.cost)
    rivals, before = [], min(one.cost for one in level)
    if ranked:  # as probable as the best one
        best = ranked[0]
        reach = max((1.0 - RIVAL) * (before - best.cost), NEAR * best.overdispersion)
        rivals = [e for e in ranked[:REFITTED] if e.cost - best.cost < reach]
    refits = side_by_side(lambda e: refitted(problem, e), rivals)
    return sorted([*refits, *ranked[len(rivals) :]], key=lambda e: e.cost)


def refitted(problem: Problem, one: Fitted) -> Fitted:
    """The explanation fitted further with its own Jacobian and each effect's best form."""
    best, settled = _converged(problem, one), DEGREES_OF_FREEDOM | one.model.given
    for law in [one.model.law(e) for e in one.model.effects]:
        for other in one.model.laws(law.id):
            if other.name == law.name or law.id in settled:
                continue
            effects = tuple(other.name if e == law.name else e for e in one.model.effects)
            model = replace(one.model, effects=effects)
            known = best if other.parameters == law.parameters else _without(best, law.id)
            start = {**best.x, **_same_size(law, other, best.x)}
            near = fit(problem, model, start, known=known)
            used = next(best.model.law(e) for e in best.model.effects if best.model.law(e).id == law.id)
            more = PER_PARAMETER * (len(other.parameters) - len(used.parameters))
            if near.cost + more < best.cost - WORTH * near.overdispersion:
                best = _converged(problem, near)
    return best


def _same_size(law: Effect, other: Effect, x: Mapping[str, float]) -> dict[str, float]:
    """{coordinate: value} of another form at this one's size, or its own if parameters differ."""
    values = law.values(x)
    return {
        other.coordinate_name(p): p.per * (p.coordinate(values[p.name]) if p.name in values else p.size)
        for p in other.parameters
    }


def _converged(problem: Problem, one: Fitted) -> Fitted:
    """Fitted until a fresh Jacobian changes nothing."""
    for _ in range(PASSES):
        here = sensitivities(problem, one)
        found = fit(problem, one.model, here.x, known=here)
        done = here.cost - found.cost < CONVERGED * found.overdispersion
        one = replace(found, jacobian=here.jacobian, own=True)
        if done:
            break
    return one


def _moved(problem: Problem, first: Fitted, one: Fitted) -> Fitted:
    """A single effect in another metric. first: without effects, there.

    If its old numbers give a worse fit than no effect, start from `first` with its size.
    """
    there = _converged(problem, one)
    if there.cost < first.cost:
        return there
    again = fit(problem, one.model, {**one.x, **first.x})
    return min(there, _converged(problem, again), key=lambda e: e.cost)


def _without(fitted: Fitted, effect: str) -> Fitted:
    """The fit with the columns of all coordinates but those of an effect."""
    kept = [k for k, c in enumerate(fitted.free) if not c.name.startswith(f"{effect}.")]
    return replace(fitted, free=tuple(fitted.free[k] for k in kept), jacobian=fitted.jacobian[:, kept])


def _extended(
    problem: Problem,
    of: Fitted,
    effects: Sequence[Effect],
    width: int,
    alone: Mapping[str, Fitted],
    known: set[frozenset[str]],
) -> list[Fitted]:
    base = of if of.own else sensitivities(problem, of)
    space = tangent(base)
    free = [e for e in effects if e.id not in of.model.ids and of.effects | {e.id} not in known]

    def promise(e: Effect) -> Screened | None:
        found = [_again(problem, base, space, of.model, alone[e.id])] if e.id in alone else []
        if not found or (
            len(e.parameters) > 1 and not e.in_one_run
        ):  # alone, its shares may have been others
            found.append(screen(problem, base, space, of.model, e))
        return max((f for f in found if f), key=lambda f: f.predicted, default=None)

    screened = [s for s in side_by_side(promise, free) if s]
    worth = WORTH * base.overdispersion
    chosen = [s for s in sorted(screened, key=lambda s: -s.predicted) if s.predicted > worth][:width]
    found = list(side_by_side(partial(fit_from, problem, base), chosen))
    missed = [s.predicted - (base.cost - e.cost) for s, e in zip(chosen, found, strict=True)]
    again = [
        s.model
        for s, short in zip(chosen, missed, strict=True)
        if np.inf > short > max((1.0 - ASTRAY) * s.predicted, NEAR * base.overdispersion)
        and _starts_anywhere(s.model)
    ]
    first_far = not of.effects and base.overdispersion >= FAR_OFF
    if first_far and not any(_comes_near(base, e) for e in found):
        promising = _promising_from_start(problem, of.model, free)
        again = list({m.effects: m for m in (*again, *promising)}.values())
    found += side_by_side(partial(_from_start, problem), again)
    return list({e.effects: e for e in sorted(found, key=lambda e: -e.cost)}.values())


def _promising_from_start(problem: Problem, model: Model, effects: Sequence[Effect]) -> list[Model]:
    """Models with one more effect each, by their linear prediction at the start values.

    A fit that is far off may have settled where the right effect does not help.
    """
    rows = problem.residual(model, model.start)
    far = Fitted(model, model.start, model.free, 0.0, rows, np.empty((rows.size, 0)))
    begin = sensitivities(problem, far)
    space = tangent(begin)
    screened = side_by_side(lambda e: screen(problem, begin, space, model, e), effects)
    pairs = zip(screened, effects, strict=True)
    promising = [(s.predicted, s.model) if s else (0.0, model.with_effect(e.name)) for s, e in pairs]
    ranked = sorted(promising, key=lambda pair: -pair[0])
    return [m for _, m in ranked if _starts_anywhere(m)][:REFITTED]


def _starts_anywhere(model: Model) -> bool:
    """False where the last effect is an event, whose time must be known, or a degree of freedom."""
    law = model.law(model.effects[-1])
    return not law.in_one_run and law.id not in DEGREES_OF_FREEDOM


def _from_start(problem: Problem, model: Model) -> Fitted:
    """A model fitted from the start values and its last effect's own size; fewer steps without the metric."""
    law = model.law(model.effects[-1])
    start = model.start | {law.coordinate_name(p): p.size * p.per for p in law.parameters}
    return _converged(problem, fit(problem.plain, model, start))


def _again(problem: Problem, base: Fitted, space: Tangent, model: Model, alone: Fitted) -> Screened | None:
    """The linear prediction of an effect that was fitted alone, at the size that it had there."""
    name = alone.model.effects[-1]
    law = alone.model.law(name)
    happened_in = alone.model.happened_in if law.in_one_run else ""
    more = model.with_effect(name, happened_in, alone.model.happened_order)
    own = {law.coordinate_name(p) for p in law.parameters} | {*law.releases}
    start = {n: alone.x[n] for n in own if n in alone.x}
    rows = problem.model(more, {**base.x, **start})
    signature = space.outside(rows - (problem.measured - base.rows))
    predicted, amount = score(signature, space.outside(base.rows))
    return Screened(law.id, more, predicted, start) if amount > 0 or law.signed else None
