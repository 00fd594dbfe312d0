"""Each effect added to a model and fitted: what it would explain of the residual."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from rover_sweep.diagnosis.candidates import WHOLE, Model, own
from rover_sweep.diagnosis.fitting import Fitted, fit
from rover_sweep.diagnosis.problem import Problem
from rover_sweep.identify.effects import Effect
from rover_sweep.identify.recording import Array

SIZES = (0.25, 0.5, 1.0, 2.0)  # of an effect's plain size, at which the first look is taken
INSTANTS = 9
WORTH_A_FIT = 4.0


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


def first_look(problem: Problem, base: Fitted, model: Model, effect: Effect) -> list[dict[str, float]]:
    """Coordinates of the effect to begin a fit from, {name: coordinate}; none where it explains nothing."""
    if effect.id in WHOLE or not own(effect):
        return [{}]
    starts = _starts(effect, problem, model)
    structure = model.structure
    seen = problem.models(structure, [{**base.x, **s} for s in starts])
    now = problem.measured - base.rows
    tang = tangent(base)
    outside = tang.outside(base.rows)
    scored = []
    for start, rows in zip(starts, seen, strict=True):
        signature = tang.outside(rows - now)
        power = float(signature @ signature)
        if power < 1e-6:
            continue
        amount = float(signature @ outside) / power
        if amount <= 0 and not effect.signed:
            continue
        scored.append((amount * amount * power, amount, start))
    if not scored:
        return []
    scored.sort(key=lambda s: -s[0])
    return [
        {k: v * float(np.sign(a) * np.clip(abs(a), 0.5, 2.0)) if not k.endswith(".t") else v for k, v in start.items()}
        for _, a, start in scored[:1]
    ]


def _starts(effect: Effect, problem: Problem, model: Model) -> list[dict[str, float]]:
    if effect.id == "surface_change":
        run = next(r for r in problem.runs if r.name == model.happened_in)
        instants = np.linspace(0.12, 0.88, INSTANTS) * run.t[-1]
        size = effect.parameters[0].size
        return [{effect.key("ratio"): size, effect.key("t"): float(t)} for t in instants]
    names = [effect.key(name) for name in effect.adds]
    sizes = {effect.key(p.name): p.size for p in effect.parameters}
    whole = [{n: f * sizes[n] for n in names} for f in SIZES]
    if len(names) == 1:
        return whole
    return [{n: (f * sizes[n] if n == one else 0.0) for n in names} for one in names for f in SIZES]


def tried(problem: Problem, base: Fitted, model: Model, effect: Effect) -> Trial | None:
    """The model with the effect, fitted from the best first look; None where it explains nothing."""
    runs = [r.name for r in problem.runs] if effect.stage == "grip" else [""]
    best: Trial | None = None
    for run in runs:
        extended = model.with_effect(effect.id, run)
        for start in first_look(problem, base, extended, effect):
            known = None if effect.id in WHOLE else base
            found = fit(problem, extended.structure, extended.free, {**base.x, **start}, known=known)
            trial = Trial(effect.id, extended, found, base.cost - found.cost)
            if best is None or trial.gain > best.gain:
                best = trial
    return best


def all_tried(
    problem: Problem,
    base: Fitted,
    model: Model,
    effects: Sequence[Effect],
    progress: Callable[[str, float], None],
    stop: Callable[[], bool],
) -> list[Trial]:
    """Every effect tried on its own beside a model, the best first; fewer when stopped."""
    out = []
    for k, effect in enumerate(effects):
        if stop():
            break
        progress(f"trying {effect.title}", k / max(len(effects), 1))
        trial = tried(problem, base, model, effect)
        if trial is not None:
            out.append(trial)
    return sorted(out, key=lambda t: -t.gain)


__all__ = ["Trial", "all_tried", "first_look", "tangent", "tried"]
