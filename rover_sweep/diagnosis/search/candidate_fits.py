"""Each effect added to a model and fitted: how much of the residual it explains.

In three stages, since a fit costs many simulations: the linear prediction of all effects (a score test), a
fit of those that promise most with the nominal Jacobian of the base, and a second fit of the best with
their own Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from scipy.linalg import qr

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.problem.least_squares import Fitted, fit
from rover_sweep.diagnosis.problem.residuals import Problem, Stopped
from rover_sweep.diagnosis.simulation.candidates import DEGREES_OF_FREEDOM, Model, added_coordinates
from rover_sweep.spectra.side_by_side import side_by_side

Item = TypeVar("Item")
Result = TypeVar("Result")

SIZES = (0.25, 1.0)  # of an effect's own size, at which its signature is computed
SCANNED = np.geomspace(0.25, 4.0, 112)  # sizes of a law that jumps: 2.5 % apart
SCANNED_FROM = 30.0  # predicted gain from which they are
BESIDE = (0.985, 1.015, 0.97, 1.03)  # of the scanned size
FEW = 3  # steps of those fits
INSTANTS = 7  # at which a change of ground is tried in each run
NO_GAIN = 2.0  # predicted gain below which an effect explains nothing
FITTED_FROM = 0.25  # share of the threshold from which a predicted gain is followed by a fit
ASTRAY = 0.5  # share of the predicted gain below which a fit is repeated from nearer
NEARER = 0.3  # share of the way to the first start, for that repetition
FITTED = 9  # most effects that are fitted
REFITTED = 5  # most trials that are fitted again
RESTARTED = 2  # most trials that are also fitted from their own size
FAR = 2.0  # mean square of the base's rows from which trials are fitted from their own size
REFIT_STEPS = 5  # the next round continues the best one
REFITTED_FROM = 0.4  # share of the threshold from which a trial is fitted again
FORMS_OF = 2  # most trials whose forms are compared
RIVAL_FORMS = 0.5  # share of the best gain from which the forms of a trial are compared
SIMPLER = 0.005  # share of the gain that decides nothing between two forms
NEAR_FORM = 0.7  # share of the best form's gain from which another form is fitted again
RIVAL = 0.2  # share of the best gain below which a trial is not fitted again


@dataclass(frozen=True, eq=False)
class Trial:
    """A model with one more effect, fitted. gain: drop of the cost against the model without.

    Where `fitted` is the fit of the base, the effect was not fitted and `gain` is a linear prediction.
    effect: the id. forms: {form: gain} of the forms that were fitted.
    """

    effect: str
    model: Model
    fitted: Fitted
    gain: float
    forms: Mapping[str, float] = field(default_factory=dict)

    @property
    def law(self) -> Effect:
        """The law of the effect."""
        return next(f for f in map(self.model.law, self.model.effects) if f.id == self.effect)


@dataclass(frozen=True, eq=False)
class Tangent:
    """The directions in which a fitted model can move its rows, orthonormal.

    q (rows + k, k) for k coordinates that are inside their bounds: below the `rows` of the data is one
    row for the prior of each coordinate, so that a prior limits the movement.
    """

    q: Array
    rows: int

    def outside(self, residual: Array) -> Array:
        """The part (rows + k, ...) of residuals (rows,) or (rows, m) that the model cannot reach."""
        full = np.zeros((self.q.shape[0], *residual.shape[1:]))
        full[: self.rows] = residual
        return full - self.q @ (self.q.T @ full)


def tangent(fitted: Fitted) -> Tangent:
    """The tangent of a fit at its coordinates."""
    loose = [
        k
        for k, c in enumerate(fitted.free)
        if c.low + 1e-6 * c.scale < fitted.x[c.name] < c.high - 1e-6 * c.scale
    ]
    columns = fitted.jacobian[:, loose]
    prior = [fitted.free[k].scale / p if (p := fitted.free[k].prior) else 0.0 for k in loose]
    stacked = np.vstack((columns, np.diag(prior)))
    q = qr(stacked, mode="economic")[0]
    return Tangent(q, fitted.rows.size)


def linear_prediction(
    problem: Problem, base: Fitted, space: Tangent, model: Model, effect: Effect
) -> tuple[float, dict[str, float]] | None:
    """(gain predicted by the score test, {coordinate: value} to begin a fit from); None: no gain.

    space: tangent of the base. The best of several sizes, or instants, counts.
    """
    starts = _starts(effect, problem, base, model)
    models = problem.models(model.structure, [{**base.x, **s} for s in starts])
    now = problem.measured - base.rows
    outside = space.outside(base.rows)
    best: tuple[float, float, dict[str, float]] | None = None
    for start, rows in zip(starts, models, strict=True):
        signature = space.outside(rows - now)
        power = float(signature @ signature)
        if power < 1e-6:
            continue
        amount = float(signature @ outside) / power
        predicted = amount * amount * power
        if (amount > 0 or effect.signed) and (best is None or predicted > best[0]):
            best = predicted, amount, start
    if best is None or (best[0] < NO_GAIN and added_coordinates(effect)):
        return None
    predicted, amount, start = best
    if any(p.jumps for p in effect.parameters) and predicted > SCANNED_FROM:
        return _scanned(problem, base, space, model, effect)
    factor = float(np.sign(amount) * np.clip(abs(amount), 0.5, 2.0))
    return predicted, {
        k: v if k.endswith(".t") else base.x.get(k, 0.0) + (v - base.x.get(k, 0.0)) * factor
        for k, v in start.items()
    }


def _scanned(
    problem: Problem, base: Fitted, space: Tangent, model: Model, effect: Effect
) -> tuple[float, dict[str, float]]:
    """(predicted gain, coordinates) of the best of many sizes of a law that jumps, each taken as it is."""
    name, size = next((effect.key(p.name), p.size) for p in effect.parameters if p.jumps)
    starts = [{name: float(f * size)} for f in SCANNED]
    whole = float(np.sum(space.outside(base.rows) ** 2))
    models = problem.models(model.structure, [{**base.x, **s} for s in starts])
    left = [float(np.sum(space.outside(problem.measured - rows) ** 2)) for rows in models]
    best = int(np.argmin(left))
    return max(whole - left[best], 0.0), starts[best]


def _starts(effect: Effect, problem: Problem, base: Fitted, model: Model) -> list[dict[str, float]]:
    if effect.in_one_run and len(effect.parameters) > 1:
        run = next(r for r in problem.runs if r.name == model.happened_in)
        instants = np.linspace(0.12, 0.88, INSTANTS) * run.t[-1]
        size = effect.parameters[0].size
        return [{effect.key("ratio"): size, effect.key("t"): float(t)} for t in instants]
    sizes = {effect.coordinate_name(p): p.size * p.per for p in effect.parameters}
    limits = {c.name: (c.low, c.high) for c in model.free}
    out = []
    for one, size in sizes.items():
        low, high = limits[one]
        now = base.x.get(one, 0.0)
        ends = [float(np.clip(now + f * size, low, high)) for f in SIZES]
        out += [{n: (end if n == one else base.x.get(n, 0.0)) for n in sizes} for end in ends]
    return out


@dataclass(frozen=True, eq=False)
class Screened:
    """An effect with its predicted gain, the model with it, and the coordinates to begin a fit from.

    effect: the id; the form is in the model.
    """

    effect: str
    model: Model
    predicted: float
    start: Mapping[str, float]


def screen(problem: Problem, base: Fitted, space: Tangent, model: Model, effect: Effect) -> Screened | None:
    """The linear prediction of an effect: its best form, in the run that shows it best; None: no gain."""
    if effect.id in DEGREES_OF_FREEDOM:
        return Screened(effect.id, model.with_effect(effect.id), np.inf, {})
    extended = [
        (law, model.with_effect(law.name, run.name if law.in_one_run else "", run.order))
        for law in model.laws(effect.id)
        for run in (problem.runs if law.in_one_run else problem.runs[:1])
    ]
    found = [(m, linear_prediction(problem, base, space, m, law)) for law, m in extended]
    screened = [Screened(effect.id, m, *one) for m, one in found if one is not None]
    return max(screened, key=lambda x: x.predicted, default=None)


def fit_from(problem: Problem, base: Fitted, one: Screened) -> Trial:
    """The model with the effect, fitted from its linear prediction."""
    free, structure = one.model.free, one.model.structure
    known = None if one.effect in DEGREES_OF_FREEDOM else base
    law = one.model.law(one.model.effects[-1])
    if any(p.jumps for p in law.parameters):
        return _around_the_scanned(problem, base, one, law)
    found = fit(problem, structure, free, {**base.x, **one.start}, known=known)
    if known is not None and base.cost - found.cost < ASTRAY * one.predicted:
        nearer = {k: v if k.endswith(".t") else _between(base.x.get(k, 0.0), v) for k, v in one.start.items()}
        again = fit(problem, structure, free, {**base.x, **nearer}, known=known)
        found = again if again.cost < found.cost else found
    return Trial(one.effect, one.model, found, base.cost - found.cost)


def _around_the_scanned(problem: Problem, base: Fitted, one: Screened, law: Effect) -> Trial:
    """A law that jumps: the other coordinates are fitted at the scanned size and beside it, then all."""
    jumping = {law.key(p.name) for p in law.parameters if p.jumps}
    others = tuple(c for c in one.model.free if c.name not in jumping)
    best = fit(problem, one.model.structure, others, {**base.x, **one.start}, steps=FEW, known=base)
    for factor in BESIDE:
        size = {name: one.start[name] * factor for name in jumping if name in one.start}
        found = fit(problem, one.model.structure, others, {**best.x, **size}, steps=FEW, known=base)
        best = found if found.cost < best.cost else best
    whole = fit(problem, one.model.structure, one.model.free, best.x, steps=1)
    return Trial(one.effect, one.model, whole, base.cost - whole.cost)


def fit_candidate(
    problem: Problem, base: Fitted, space: Tangent, model: Model, effect: Effect
) -> Trial | None:
    """The model with the effect, fitted; None where the linear prediction shows no gain."""
    one = screen(problem, base, space, model, effect)
    return None if one is None else fit_from(problem, base, one)


def _between(now: float, start: float) -> float:
    return now + NEARER * (start - now)


def fit_candidates(
    problem: Problem,
    base: Fitted,
    space: Tangent,
    model: Model,
    effects: Sequence[Effect],
    thresholds: Mapping[str, float],
    progress: Callable[[str, float], None],
    origin: Fitted | None = None,
) -> list[Trial]:
    """Every effect added alone to a model, the largest gain first; fewer when the problem's stop is true.

    Those with the largest predicted gains near their thresholds {effect: gain} are fitted, with the
    nominal Jacobian of the base. The others keep their predicted gain. origin: the model at its start values,
    where the base is far off: it may have settled where no effect helps, so all are fitted from there too.
    """
    screened: list[Screened] = []
    tested = _until_stopped(lambda e: screen(problem, base, space, model, e), effects, lambda e: None)
    for k, (effect, found) in enumerate(zip(effects, tested, strict=True)):
        progress(f"testing {effect.title}", 0.5 * k / max(len(effects), 1))
        screened += [found] if found is not None else []
    screened.sort(key=lambda x: -x.predicted)
    promising = [x for x in screened if x.predicted >= FITTED_FROM * thresholds.get(x.effect, 0.0)][:FITTED]
    out = [Trial(x.effect, x.model, base, x.predicted) for x in screened if x not in promising]
    fits = _until_stopped(lambda x: fit_from(problem, base, x), promising, lambda x: None)
    for k, (one, trial) in enumerate(zip(promising, fits, strict=True)):
        progress(f"fitting {one.effect}", 0.5 + 0.5 * k / len(promising))
        if trial is not None:
            out.append(trial)
        elif one.effect not in DEGREES_OF_FREEDOM:
            out.append(Trial(one.effect, one.model, base, one.predicted))
    if origin is not None:
        known = {t.effect for t in out}
        others = [
            _unfitted(model, base, e)
            for e in effects
            if e.id not in known and not e.in_one_run and e.id not in DEGREES_OF_FREEDOM
        ]
        every = (*out, *others)
        again = _until_stopped(lambda t: _from_origin(problem, base, origin, model, t), every, lambda t: t)
        out = [t for t, before in zip(again, every, strict=True) if before in out or t.fitted is not base]
    return sorted(out, key=lambda t: -t.gain)


def _until_stopped(
    work: Callable[[Item], Result], items: Sequence[Item], instead: Callable[[Item], Result]
) -> Iterator[Result]:
    """work(item) of each item side by side, instead(item) of those that a stop cut off."""

    def one(item: Item) -> Result:
        try:
            return work(item)
        except Stopped:
            return instead(item)

    return side_by_side(one, items)


def _unfitted(model: Model, base: Fitted, effect: Effect) -> Trial:
    return Trial(effect.id, model.with_effect(effect.id), base, 0.0)


def _from_origin(problem: Problem, base: Fitted, origin: Fitted, model: Model, trial: Trial) -> Trial:
    """The trial fitted from the model's start values and the effect's own size, where that is better."""
    if trial.law.in_one_run or trial.effect in DEGREES_OF_FREEDOM:
        return trial
    sizes = {trial.law.coordinate_name(p): p.size * p.per for p in trial.law.parameters}
    start = {**origin.x, **sizes}
    found = fit(problem, trial.model.structure, trial.model.free, start, known=origin)
    gain = base.cost - found.cost
    fitted = trial.fitted is not base
    better = gain > (trial.gain if fitted else 0.0)
    return replace(trial, fitted=found, gain=gain) if better else trial


def refit_candidates(
    problem: Problem, base: Fitted, trials: Sequence[Trial], thresholds: Mapping[str, float]
) -> list[Trial]:
    """The trials, the best fitted again with their own Jacobian; thresholds: {effect: gain}."""
    best = max((t.gain for t in trials), default=0.0)

    def again(ranked: tuple[int, Trial]) -> Trial:
        rank, trial = ranked
        near = trial.gain > max(REFITTED_FROM * thresholds.get(trial.effect, 0.0), RIVAL * best)
        if trial.fitted is base or not near or rank >= REFITTED:
            return trial
        found = refitted(problem, base, trial)
        if rank < RESTARTED and base.overdispersion > FAR:
            other = _restarted(problem, base, found)
            found = other if other.gain > found.gain else found
        return found

    refits = _until_stopped(again, list(enumerate(trials)), lambda ranked: ranked[1])
    out = sorted(refits, key=lambda t: -t.gain)
    rivals = [
        t
        for t in out[:FORMS_OF]
        if t.fitted is not base and t.gain > max(RIVAL_FORMS * out[0].gain, thresholds.get(t.effect, 0.0))
    ]
    forms = _until_stopped(lambda t: best_form(problem, base, t), rivals, lambda t: t)
    compared = {t.effect: t for t in forms}
    return sorted((compared.get(t.effect, t) for t in out), key=lambda t: -t.gain)


def _restarted(problem: Problem, base: Fitted, trial: Trial) -> Trial:
    """The trial fitted from its own size: where the nominal fit is far off, the path from zero may fail."""
    plain = {
        c.name: c.scale if c.start == 0.0 else c.start
        for c in added_coordinates(trial.law)
        if not c.name.endswith(".t")
    }
    restart = replace(trial, fitted=replace(trial.fitted, x={**trial.fitted.x, **plain}))
    return refitted(problem, base, restart)


def refitted(problem: Problem, base: Fitted, trial: Trial) -> Trial:
    """The trial fitted again with its own Jacobian."""
    found = fit(problem, trial.model.structure, trial.model.free, trial.fitted.x, steps=REFIT_STEPS)
    return replace(trial, fitted=found, gain=base.cost - found.cost)


def best_form(problem: Problem, base: Fitted, trial: Trial) -> Trial:
    """The form of the trial's effect that explains most, with the gains of all its forms.

    The first form of an effect is the simplest; another one must explain more than it by `SIMPLER`.
    """
    law = trial.law
    best, tried = trial, {law.form: trial}
    laws = trial.model.laws(trial.effect)
    for other in laws:
        if other.name == law.name or trial.effect in DEGREES_OF_FREEDOM:
            continue
        effects = tuple(other.name if e == law.name else e for e in trial.model.effects)
        model = replace(trial.model, effects=effects)
        known = trial.fitted if other.parameters == law.parameters else base
        near = fit(problem, model.structure, model.free, trial.fitted.x, steps=REFIT_STEPS, known=known)
        found = Trial(trial.effect, model, near, base.cost - near.cost)
        if found.gain > NEAR_FORM * best.gain:
            again = refitted(problem, base, found)
            found = again if again.gain > found.gain else found
        tried[other.form] = found
        best = found if found.gain > best.gain else best
    first = tried.get(laws[0].form, best)
    best = first if first.gain > (1.0 - SIMPLER) * best.gain else best
    return replace(best, forms={form: t.gain for form, t in tried.items()})
