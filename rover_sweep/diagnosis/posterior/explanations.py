"""Explanations of a baseline's residual: sets of effects, all fitted in the same problem.

A beam search. Each effect is added to the best explanations so far, from its linear prediction (a score test,
see `search`), and fitted to the end. Where the baseline is far off, a linear prediction says little: there
each effect is looked at from several starts, and fitted to the end from the best one.

All explanations are fitted in one metric with one noise floor, so that their costs can be compared. Where the
explanation at which the metric was made is far off and another is not, the metric is made again there.

At the end the pool is closed: no explanation becomes cheaper when it is fitted from another one's numbers. So
it is a fixed point of the search, and a function of the data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import inf

from rover_sweep.data.results import Progress
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.posterior.weights import LEAST_GAIN
from rover_sweep.diagnosis.problem.least_squares import (
    COARSE,
    FAR_OFF,
    FINISHED,
    ROUGH,
    Fitted,
    first_steps,
    fit,
    sensitivities,
)
from rover_sweep.diagnosis.problem.residuals import Problem, Stopped
from rover_sweep.diagnosis.search import (
    PER_PARAMETER,
    Screened,
    Tangent,
    score,
    screen,
    screened_forms,
    tangent,
)
from rover_sweep.diagnosis.simulation.candidates import DEGREES_OF_FREEDOM, Model, added_coordinates
from rover_sweep.spectra.side_by_side import side_by_side

DONE = (0.2, 0.5, 0.7)  # shares of the whole work at which the levels begin, as in typical diagnoses
WIDTH = (10, 4, 2)  # effects that are fitted to an explanation of 0, 1, 2 effects
BEAM = (1, 2, 1)  # explanations of 0, 1, 2 effects that are extended
NEAR = 60.0  # difference of the costs over a row's variance up to which an explanation may be right
WORTH = 6.0  # gain over a row's variance below which no effect is more probable than none
BEATEN = 30.0  # ln of odds from which something without a name ends the search
Pool = dict[frozenset[str], Fitted]
Starts = Sequence[tuple[Model, Mapping[str, float], Fitted | None]]
"""Each a model, coordinates to begin from, and a fit whose derivatives are near; None where there is none."""


def explored(
    problem: Problem,
    first: Fitted,
    closest: Fitted,
    effects: Sequence[Effect],
    nearer: Callable[[Fitted], tuple[Problem, Fitted, Fitted]],
    unnamed: Callable[[Problem, Fitted], float],
    progress: Progress = lambda what, share: None,
) -> tuple[Problem, Fitted, list[Fitted]]:
    """(problem, explanation at which its metric was made, all explanations found), the smallest cost first.

    first: without effects, fitted to the problem, whose metric was made at it; closest: fitted to the problem
    without metric. nearer(explanation): the problem with floor and metric made there, `first` and the
    explanation in it. unnamed(problem, explanation): ln weight of something unnamed in its residual; if that
    of `first` is far above the best single effect, no further one is tried. If the problem's stop is true,
    the search ends early. progress(activity, share of all the work).
    """
    pool: Pool = {first.effects: first}
    level, made_at = [first], first
    for depth, (width, beam) in enumerate(zip(WIDTH, BEAM, strict=True)):
        progress(f"trying {('single effects', 'pairs of effects', 'three effects')[depth]}", DONE[depth])
        try:
            if not depth and first.far_off:
                ranked = _from_afar(problem, closest, effects)
                near = _comes_near(closest, ranked[0]) if ranked else False
            else:
                ranked = _next_level(problem, level[:beam], width, effects, pool)
                ranked = sorted(ranked, key=lambda e: e.cost)
                near = _comes_near(pool[made_at.effects], ranked[0]) if ranked else False
            pool |= {e.effects: e for e in ranked}
            if near:  # far off, the rows of a metric are not those of the rover
                problem, first, made_at = nearer(ranked[0])
                pool = _moved(problem, first, made_at, pool)
            pool |= {e.effects: e for e in _finished(problem, list(pool.values()))}
        except Stopped:
            break
        ranked = sorted((pool[e.effects] for e in ranked), key=lambda e: e.cost)
        before = min(pool[one.effects].cost for one in level)
        if not ranked or before - ranked[0].cost < LEAST_GAIN * ranked[0].overdispersion:
            break
        # something without a name is far more probable than an effect, whatever is added to that
        gain = (first.cost - ranked[0].cost) / (2.0 * COARSE * ranked[0].overdispersion)
        if not depth and unnamed(problem, first) > gain + BEATEN:
            break
        level = ranked
    try:
        pool = _closed(problem, pool)
        if not pool[first.effects].finished:
            pool[first.effects] = fit(problem, first.model, pool[first.effects].x)
        pool |= {e.effects: e for e in _missing_parts(problem, pool)}
    except Stopped:
        pass
    return problem, made_at, sorted(pool.values(), key=lambda e: e.cost)


def _comes_near(base: Fitted, best: Fitted) -> bool:
    """True if a base is far off and an explanation leaves little of its residual."""
    return base.overdispersion >= FAR_OFF * best.overdispersion


def _next_level(
    problem: Problem, level: Sequence[Fitted], width: int, effects: Sequence[Effect], pool: Pool
) -> list[Fitted]:
    """The best of a level with one more effect each."""
    alone = {next(iter(e.effects)): e for e in pool.values() if len(e.effects) == 1}
    starts: dict[frozenset[str], tuple[float, Starts]] = {}
    for one in level:
        free = [e for e in effects if e.id not in one.model.ids]
        new = [e for e in free if one.effects | {e.id} not in {*pool, *starts}]
        for found in _promising(problem, one, new, width, alone):
            known = None if found.effect in DEGREES_OF_FREEDOM else one
            start = found.model, {**one.x, **found.start}, known
            starts[one.effects | {found.effect}] = one.cost - found.predicted, [start]
    if not starts:
        return []
    first, *others = (some for _, some in sorted(starts.values(), key=lambda pair: pair[0]))
    best = _best_of(problem, first)
    useful = _useful(min((best, *pool.values()), key=lambda e: e.cost))
    return [best, *side_by_side(lambda some: _best_of(problem, some, useful), others)]


def _finished(problem: Problem, pool: Sequence[Fitted]) -> list[Fitted]:
    """Those of a pool that may be right and were not fitted to the end, fitted so, in their best forms."""
    best = min(pool, key=lambda e: e.cost)
    done = [] if best.finished else [refitted(problem, fit(problem, best.model, best.x, known=best))]
    useful = _useful(min((best, *done), key=lambda e: e.cost))
    rivals = [e for e in pool if e is not best and not e.finished and e.cost < useful]

    def finished(e: Fitted) -> Fitted:
        found = fit(problem, e.model, e.x, known=e, useful=useful)
        return refitted(problem, found) if found.finished else found

    return [*done, *side_by_side(finished, rivals)]


def _promising(
    problem: Problem, base: Fitted, effects: Sequence[Effect], width: int, alone: Mapping[str, Fitted]
) -> list[Screened]:
    """The linear predictions of the effects that promise most, as many as the width."""
    space = tangent(base)

    def promise(e: Effect) -> Screened | None:
        found = [_again(problem, base, space, base.model, alone[e.id])] if e.id in alone else []
        # alone, its shares may have been others
        if not found or (len(e.parameters) > 1 and not e.in_one_run):
            found.append(screen(problem, base, space, base.model, e))
        return max((f for f in found if f), key=lambda f: f.predicted, default=None)

    screened = [s for s in side_by_side(promise, effects) if s and s.predicted > WORTH * base.overdispersion]
    return sorted(screened, key=lambda s: -s.predicted)[:width]


def _from_afar(problem: Problem, base: Fitted, effects: Sequence[Effect]) -> list[Fitted]:
    """Each effect added to a base that is far off, the smallest cost first.

    They are fitted without the metric, which such a base cannot give, and looked at in it where no effect
    comes near. Every form is fitted, from several starts: its linear prediction and its own sizes, from the
    base and from the nominal numbers.
    """
    plain = problem.plain
    rows = plain.residual(base.model, base.model.start)
    nominal = sensitivities(plain, replace(base, x=base.model.start, rows=rows))
    starts: dict[tuple[str, ...], list[tuple[Model, Mapping[str, float], Fitted | None]]] = {}
    for place in (base, nominal):
        space = tangent(place)
        for found in side_by_side(partial(screened_forms, plain, place, space, base.model), effects):
            for one in found:
                known = None if one.effect in DEGREES_OF_FREEDOM else place
                some = starts.setdefault(one.model.effects, [])
                some.append((one.model, {**place.x, **one.start}, known))
        for effect in effects:
            if effect.in_one_run or effect.id in DEGREES_OF_FREEDOM:
                continue
            for law in base.model.laws(effect.id):
                more = base.model.with_effect(law.name)
                some = starts.setdefault(more.effects, [])
                some += [(more, {**place.x, **sizes}, place) for sizes in _own_sizes(law)]
    found = sorted(side_by_side(partial(_where_to_begin, plain), list(starts.values())), key=lambda e: e.cost)
    nearest = fit(plain, found[0].model, found[0].x, roughly=True)
    near = side_by_side(lambda e: fit(plain, e.model, e.x, roughly=True, useful=_useful(nearest)), found[1:])
    fits: dict[frozenset[str], Fitted] = {}
    for e in (nearest, *near):
        before = fits.get(e.effects)
        if before is None or _cost_of_form(e) < _cost_of_form(before):
            fits[e.effects] = e
    if not any(_comes_near(base, e) for e in fits.values()):
        known = [replace(e, jacobian=problem.of(e.jacobian)) for e in fits.values()]
        return sorted(
            side_by_side(lambda e: first_steps(problem, e.model, e.x, e), known), key=lambda e: e.cost
        )
    return sorted(fits.values(), key=lambda e: e.cost)


def _cost_of_form(e: Fitted) -> float:
    """The cost with what each parameter of a form must bring."""
    return e.cost + PER_PARAMETER * sum(len(e.model.law(name).parameters) for name in e.model.effects)


def _own_sizes(law: Effect) -> list[dict[str, float]]:
    """The law at its own size, of either sign where it has both."""
    sizes = {law.coordinate_name(p): p.size * p.per for p in law.parameters}
    return [sizes, {n: -v for n, v in sizes.items()}] if law.signed else [sizes]


def _where_to_begin(problem: Problem, starts: Starts) -> Fitted:
    """Where the start leads that leads to the smallest cost; the first one where nothing tells them apart."""
    near = [(model, x, known) for model, x, known in starts if known is not None]
    if len(near) < len(starts):
        return fit(problem, starts[0][0], starts[0][1], roughly=True)
    return min((first_steps(problem, *start) for start in near), key=lambda e: e.cost)


def _best_of(problem: Problem, starts: Starts, useful: float = inf) -> Fitted:
    """The fit from the start that leads to the smallest cost. useful: see `fit`."""
    if len(starts) == 1:
        model, x, known = starts[0]
        return fit(problem, model, x, known=known, roughly=True, useful=useful)
    best = _where_to_begin(problem, starts)
    return fit(problem, best.model, best.x, roughly=True, useful=useful)


def _useful(best: Fitted) -> float:
    """The largest cost of an explanation that may be right, next to the best one."""
    return best.cost + NEAR * best.overdispersion


def refitted(problem: Problem, best: Fitted) -> Fitted:
    """The explanation with each effect's best form."""
    settled = DEGREES_OF_FREEDOM | best.model.given
    for law in [best.model.law(e) for e in best.model.effects]:
        for other in best.model.laws(law.id):
            if other.name == law.name or law.id in settled:
                continue
            effects = tuple(other.name if e == law.name else e for e in best.model.effects)
            model = replace(best.model, effects=effects)
            known = best if other.parameters == law.parameters else _without(best, law.id)
            more = PER_PARAMETER * (len(law.parameters) - len(other.parameters))
            start = {**best.x, **_same_size(law, other, best.x)}
            near = fit(problem, model, start, known=known, roughly=True, useful=best.cost + more)
            if _cost_of_form(near) < _cost_of_form(best) + ROUGH * best.overdispersion:
                near = fit(problem, model, near.x, known=near)
            if _cost_of_form(near) < _cost_of_form(best) - FINISHED * best.overdispersion:
                best = near
    return best


def _same_size(law: Effect, other: Effect, x: Mapping[str, float]) -> dict[str, float]:
    """{coordinate: value} of another form at this one's size, or its own if parameters differ."""
    values = law.values(x)
    return {
        other.coordinate_name(p): p.per * (p.coordinate(values[p.name]) if p.name in values else p.size)
        for p in other.parameters
    }


def _without(fitted: Fitted, effect: str) -> Fitted:
    """The fit with the columns of all coordinates but those of an effect."""
    kept = [k for k, c in enumerate(fitted.free) if not c.name.startswith(f"{effect}.")]
    return replace(fitted, free=tuple(fitted.free[k] for k in kept), jacobian=fitted.jacobian[:, kept])


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


def _missing_parts(problem: Problem, pool: Pool) -> list[Fitted]:
    """The best explanation without each of its effects, and the best of these again, where they were not
    found: a larger one must be worth more than its parts."""
    best, missing = min(pool.values(), key=lambda e: e.cost), list[Fitted]()
    while len(best.effects) > 1 and not problem.stop():
        parts = [best.effects - {i} for i in sorted(best.effects)]
        known = [pool[p] for p in parts if p in pool]
        unknown = [p for p in parts if p not in pool]
        new = list(side_by_side(partial(_part_of, problem, best), unknown))
        missing += new
        best = min((*known, *new), key=lambda e: e.cost)
    return missing


def _part_of(problem: Problem, whole: Fitted, effects: frozenset[str]) -> Fitted:
    """The explanation with one effect less, fitted from where the whole one is."""
    (effect,) = whole.effects - effects
    model = whole.model.without(effect)
    start = {c.name: whole.x.get(c.name, c.start) for c in model.free}
    return fit(problem, model, start, known=None if effect in DEGREES_OF_FREEDOM else _without(whole, effect))


# The end of a search: no explanation becomes cheaper from another one's numbers.


def _moved(problem: Problem, first: Fitted, near: Fitted, old: Pool) -> Pool:
    """The explanations in another metric, in which `first`, without effects, and `near` are fitted.

    Each begins from the numbers of one of these, its own effects as they were, or from its own numbers.
    """

    def moved(e: Fitted) -> Fitted:
        added = [c.name for name in e.model.effects for c in added_coordinates(e.model.law(name))]
        own = {n: e.x[n] for n in added}
        if DEGREES_OF_FREEDOM & e.effects:
            return fit(problem, e.model, {**e.x, **first.x}, roughly=True, useful=_useful(near))
        starts = [(e.model, {**e.x, **of.x, **own}, of) for of in (first, near, e)]
        return _best_of(problem, starts, _useful(near))

    others = [e for e in old.values() if e.effects not in (first.effects, near.effects)]
    return {e.effects: e for e in (first, near, *side_by_side(moved, others))}


def _closed(problem: Problem, pool: Pool) -> Pool:
    """The pool in which no explanation becomes cheaper from other numbers: those of the best one, and of the
    best one with an effect more or less."""
    pool = dict(pool)
    while True:
        best = min(pool.values(), key=lambda e: e.cost)
        found = list(side_by_side(partial(_cheapest, problem, pool, best), list(pool.values())))
        cheaper = [e for e in found if e.cost < pool[e.effects].cost - FINISHED * e.overdispersion]
        pool |= {e.effects: e for e in cheaper}
        pool |= {e.effects: e for e in _finished(problem, list(pool.values()))}
        if min(e.cost for e in pool.values()) > best.cost - ROUGH * best.overdispersion:
            return pool


def _cheapest(problem: Problem, pool: Pool, best: Fitted, e: Fitted) -> Fitted:
    near = [o for o in pool.values() if len(o.effects ^ e.effects) == 1]
    others = {o.effects: o for o in (best, *sorted(near, key=lambda o: o.cost)[:1]) if o is not e}
    return min([e, *(_from_numbers(problem, e, o) for o in others.values())], key=lambda f: f.cost)


def _from_numbers(problem: Problem, e: Fitted, other: Fitted) -> Fitted:
    """Where the explanation e leads from another one's numbers, its own effects at their own sizes."""
    added = {c.name for name in e.model.effects for c in added_coordinates(e.model.law(name))}
    start = {n: e.x[n] if n in added or n not in other.x else other.x[n] for n in e.x}
    return first_steps(problem, e.model, start, e)
