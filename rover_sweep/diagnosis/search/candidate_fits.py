"""Each effect added to a model and fitted: what it would explain of the residual."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import qr

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, library
from rover_sweep.diagnosis.problem.least_squares import Fitted, fit
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.simulation.candidates import WHOLE, Model, own

SIZES = (0.25, 1.0)  # of an effect's plain size, at which the first look is taken
INSTANTS = 7
NO_GAIN = 2.0  # of the gain that a first look promises, below which it explains nothing
FITTED_FROM = 0.25  # of the gain that would matter, from which a first look is followed by a fit
ASTRAY = 0.5  # of the promise, below which a fit has gone wrong
NEARER = 0.3  # of the way to the first start
FITTED = 9  # of the effects that promise most
REFITTED = 5  # trials, of at most
RESTARTED = 2  # of the best, where the nominal model is far off
FAR = 2.0  # variance of a row
REFIT_STEPS = 5  # steps; the next round fits the best one on
REFITTED_FROM = 0.4  # of what matters, from which a trial is fitted again
RIVAL = 0.2  # of the best gain, below which a trial is no rival


@dataclass(frozen=True, eq=False)
class Trial:
    """A model with one effect more, fitted. gain: drop of the cost against the model without."""

    effect: str
    model: Model
    fitted: Fitted
    gain: float


@dataclass(frozen=True, eq=False)
class Tangent:
    """The directions in which a fitted model can move its rows, orthonormal, priors taken into account.

    An active bound does not move. With a prior a coordinate moves as far as the prior lets it: the rows
    are those of the data and, below them, one row per prior.
    """

    q: Array
    rows: int

    def outside(self, residual: Array) -> Array:
        """What of residuals (rows,) or (rows, k) the model cannot reach."""
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
    """(gain it promises, coordinates {name: coordinate} to begin a fit from); None: it explains nothing.

    tang: of the base.
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
    if best is None or (best[0] < NO_GAIN and own(effect)):
        return None
    predicted, amount, start = best
    factor = float(np.sign(amount) * np.clip(abs(amount), 0.5, 2.0))
    return predicted, {
        k: v if k.endswith(".t") else base.x.get(k, 0.0) + (v - base.x.get(k, 0.0)) * factor
        for k, v in start.items()
    }


def _starts(effect: Effect, problem: Problem, base: Fitted, model: Model) -> list[dict[str, float]]:
    if effect.id == "surface_change":
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
    """What an effect promises at first sight: gain, the model with it, and where a fit of it begins."""

    effect: str
    model: Model
    predicted: float
    start: Mapping[str, float]


def screen(problem: Problem, base: Fitted, space: Tangent, model: Model, effect: Effect) -> Screened | None:
    """The first look at an effect, in the run that shows it best; None where it explains nothing."""
    if effect.id in WHOLE:
        return Screened(effect.id, model.with_effect(effect.id), np.inf, {})
    runs = [r.name for r in problem.runs] if effect.in_one_run else [""]
    extended = [model.with_effect(effect.id, run) for run in runs]
    found = [(m, linear_prediction(problem, base, space, m, effect)) for m in extended]
    screened = [Screened(effect.id, m, *one) for m, one in found if one is not None]
    return max(screened, key=lambda x: x.predicted, default=None)


def fit_from(problem: Problem, base: Fitted, one: Screened) -> Trial:
    """The model with the effect, fitted from a first look."""
    free, structure = one.model.free, one.model.structure
    known = None if one.effect in WHOLE else base
    found = fit(problem, structure, free, {**base.x, **one.start}, known=known)
    if known is not None and base.cost - found.cost < ASTRAY * one.predicted:  # led astray: from nearer by
        nearer = {k: v if k.endswith(".t") else _between(base.x.get(k, 0.0), v) for k, v in one.start.items()}
        again = fit(problem, structure, free, {**base.x, **nearer}, known=known)
        found = again if again.cost < found.cost else found
    return Trial(one.effect, one.model, found, base.cost - found.cost)


def fit_candidate(
    problem: Problem, base: Fitted, space: Tangent, model: Model, effect: Effect
) -> Trial | None:
    """The model with the effect, fitted from the best first look; None where it explains nothing."""
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
    stop: Callable[[], bool],
) -> list[Trial]:
    """Every effect tried on its own beside a model, the best first; fewer when stopped.

    All are looked at; those that promise what matters, and most, are fitted with the nominal's
    sensitivities of the base. The others are told by their promise. needed: gain that would matter.
    """
    screened: list[Screened] = []
    for k, effect in enumerate(effects):
        if stop():
            break
        progress(f"looking at {effect.title}", 0.5 * k / max(len(effects), 1))
        one = screen(problem, base, space, model, effect)
        screened += [one] if one is not None else []
    screened.sort(key=lambda x: -x.predicted)
    promising = [x for x in screened if x.predicted >= FITTED_FROM * thresholds.get(x.effect, 0.0)][:FITTED]
    out = [Trial(x.effect, x.model, base, x.predicted) for x in screened if x not in promising]
    for k, one in enumerate(promising):
        if stop():
            out += [
                Trial(x.effect, x.model, base, x.predicted) for x in promising[k:] if x.effect not in WHOLE
            ]
            break
        progress(f"fitting {one.effect}", 0.5 + 0.5 * k / len(promising))
        out.append(fit_from(problem, base, one))
    return sorted(out, key=lambda t: -t.gain)


def refit_candidates(
    problem: Problem,
    base: Fitted,
    trials: Sequence[Trial],
    thresholds: Mapping[str, float],
    stop: Callable[[], bool],
) -> list[Trial]:
    """The best trials fitted again with their own sensitivities; needed: gain of each that would matter."""
    best = max((t.gain for t in trials), default=0.0)
    out = []
    for rank, trial in enumerate(trials):
        near = trial.gain > max(REFITTED_FROM * thresholds.get(trial.effect, 0.0), RIVAL * best)
        fitted = trial.fitted is not base
        again = fitted and near and rank < REFITTED and not stop()
        found = refitted(problem, base, trial) if again else trial
        if again and rank < RESTARTED and base.overdispersion > FAR:
            other = _restarted(problem, base, found)
            found = other if other.gain > found.gain else found
        out.append(found)
    return sorted(out, key=lambda t: -t.gain)


def _restarted(problem: Problem, base: Fitted, trial: Trial) -> Trial:
    """The trial fitted from its plain size: a nominal model bent far by the effect hides its way."""
    plain = {
        c.name: c.scale if c.start == 0.0 else c.start
        for c in own(library()[trial.effect])
        if not c.name.endswith(".t")
    }
    restart = Trial(
        trial.effect, trial.model, replace(trial.fitted, x={**trial.fitted.x, **plain}), trial.gain
    )
    return refitted(problem, base, restart)


def refitted(problem: Problem, base: Fitted, trial: Trial) -> Trial:
    """The trial fitted on with its own sensitivities."""
    found = fit(problem, trial.model.structure, trial.model.free, trial.fitted.x, steps=REFIT_STEPS)
    return Trial(trial.effect, trial.model, found, base.cost - found.cost)
