"""An effect added to a model: its linear prediction (a score test), and its fit with the base's Jacobian."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.problem.least_squares import COARSE, Fitted, fit, prior_information
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.simulation.candidates import DEGREES_OF_FREEDOM, Model, added_coordinates

INSTANTS = 7  # at which a change of ground is tried in each run
PER_PARAMETER = (
    6.0 * COARSE
)  # gain that one more parameter of a form must bring: twice -ln of its Occam factor
ASTRAY = 0.5  # share of the predicted gain below which a fit is repeated from nearer
NO_GAIN = 2.0  # predicted gain below which an effect explains nothing


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
    loose = np.flatnonzero(fitted.inside)
    columns = fitted.jacobian[:, loose]
    stacked = np.vstack((columns, np.diag(np.sqrt(prior_information(fitted.free)[loose]))))
    q = qr(stacked, mode="economic")[0]
    return Tangent(q, fitted.rows.size)


def score(signature: Array, residual: Array) -> tuple[float, float]:
    """(predicted gain, amount) of a signature (n,) in a residual (n,), both outside of the model's reach.

    0.0 for both where the signature vanishes.
    """
    power = float(signature @ signature)
    amount = float(signature @ residual) / power if power >= 1e-6 else 0.0
    return amount * amount * power, amount


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
        predicted, amount = score(space.outside(rows - now), outside)
        if (amount > 0 or effect.signed) and predicted > (best[0] if best else 0.0):
            best = predicted, amount, start
    if together := _together(effect, base, space, starts, [rows - now for rows in models]):
        best = max(best or together, together, key=lambda one: one[0])
    if best is None or (best[0] < NO_GAIN and added_coordinates(effect)):
        return None
    predicted, amount, start = best
    factor = float(np.sign(amount) * np.clip(abs(amount), 0.5, 2.0))
    return predicted, {
        k: v if k.endswith(".t") else base.x.get(k, 0.0) + (v - base.x.get(k, 0.0)) * factor
        for k, v in start.items()
    }


def _together(
    effect: Effect, base: Fitted, space: Tangent, starts: Sequence[Mapping[str, float]], rows: Sequence[Array]
) -> tuple[float, float, dict[str, float]] | None:
    """(predicted gain, 1.0, start) of all parameters at once, None for an effect with one or an instant.

    rows: what each start adds; of each parameter the smallest change counts, which is nearest to linear.
    """
    names = [effect.coordinate_name(p) for p in effect.parameters]
    moved = [{n: s[n] - base.x.get(n, 0.0) for n in names} for s in starts] if not effect.in_one_run else []
    first: dict[str, int] = {}
    for k, (move, added) in enumerate(zip(moved, rows, strict=False)):
        for name in names:
            if move[name] and float(added @ added) > 0.0:
                first.setdefault(name, k)
    if len(first) < 2 or not effect.signed:
        return None
    columns = space.outside(np.column_stack([rows[k] for k in first.values()]))
    amounts, *_ = np.linalg.lstsq(columns, space.outside(base.rows))
    gain = float(np.sum((columns @ amounts) ** 2))
    change = {n: float(a) * moved[k][n] for (n, k), a in zip(first.items(), amounts, strict=True)}
    return gain, 1.0, {n: base.x.get(n, 0.0) + change.get(n, 0.0) for n in names}


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
        # a law that locks or lets slip shows nothing of its kind at a small size
        ends = dict.fromkeys(float(np.clip(now + f * size, low, high)) for f in (0.25, 1.0, 4.0, 16.0))
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
    return max(screened, key=lambda x: x.predicted - PER_PARAMETER * len(x.start), default=None)


def fit_from(problem: Problem, base: Fitted, one: Screened) -> Fitted:
    """The model with the effect, fitted from its linear prediction; from nearer where that went astray."""
    free, structure = one.model.free, one.model.structure
    known = None if one.effect in DEGREES_OF_FREEDOM else base
    found = fit(problem, structure, free, {**base.x, **one.start}, known=known)
    if known is not None and base.cost - found.cost < ASTRAY * one.predicted:
        nearer = {
            k: v if k.endswith(".t") else 0.7 * base.x.get(k, 0.0) + 0.3 * v for k, v in one.start.items()
        }
        again = fit(problem, structure, free, {**base.x, **nearer}, known=known)
        found = again if again.cost < found.cost else found
    return found
