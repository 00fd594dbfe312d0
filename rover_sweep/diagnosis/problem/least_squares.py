"""Damped least squares of a model with bounds and priors; the noise floor is found along with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.simulation.nominal import Coordinate
from rover_sweep.diagnosis.simulation.simulator import Structure

STEP = 0.02  # of a coordinate's scale, of the difference quotients


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model fitted to a problem.

    x: coordinates. cost: sum of squares of rows and priors; rows (size,): residual, measured less model.
    jacobian (size, k): of the model's rows by the free coordinates over their scales, at x.
    """

    structure: Structure
    free: tuple[Coordinate, ...]
    x: Mapping[str, float]
    cost: float
    rows: Array
    jacobian: Array

    @property
    def data_cost(self) -> float:
        """Sum of squares of the rows, without the priors."""
        return float(self.rows @ self.rows)

    @property
    def overdispersion(self) -> float:
        """Variance of a row that is left, at least 1."""
        return max(1.0, self.data_cost / self.rows.size)


def fit(
    problem: Problem,
    structure: Structure,
    free: Sequence[Coordinate],
    start: Mapping[str, float],
    steps: int = 12,
    known: Fitted | None = None,
    tolerance: float = 1e-3,
) -> Fitted:
    """Least squares over the free coordinates from `start`.

    known: a fit near by whose jacobian serves for the coordinates that it shares, so that only the new
    ones cost simulations (a chord method; `search.all_polished` goes on with a fresh one).
    """
    free = tuple(free)
    x = {**start, **{c.name: float(np.clip(start.get(c.name, c.start), c.low, c.high)) for c in free}}
    rows = problem.measured - problem.model(structure, x)
    cost = rows @ rows + _prior_cost(free, x)
    damping = 1e-3
    jacobian = np.empty((problem.size, 0))
    for _ in range(steps):
        jacobian = _jacobian(problem, structure, free, x, rows, known)
        improved = False
        for _ in range(5):
            trial = _step(free, x, jacobian, rows, damping)
            trial_rows = problem.measured - problem.model(structure, trial)
            trial_cost = trial_rows @ trial_rows + _prior_cost(free, trial)
            if trial_cost < cost:
                improved = True
                break
            damping *= 10.0
        if not improved:
            break
        gain = cost - trial_cost
        x, rows, cost = trial, trial_rows, trial_cost
        damping = max(damping / 10.0, 1e-7)
        if gain < tolerance + 1e-5 * cost:
            break
    return Fitted(structure, free, x, float(cost), rows, jacobian)


def sensitivities(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with a jacobian taken at its own coordinates."""
    fresh = _jacobian(problem, fitted.structure, fitted.free, fitted.x, fitted.rows, None)
    return replace(fitted, jacobian=fresh)


def _jacobian(
    problem: Problem,
    structure: Structure,
    free: Sequence[Coordinate],
    x: Mapping[str, float],
    rows: Array,
    known: Fitted | None,
) -> Array:
    have = {c.name: known.jacobian[:, k] * 1.0 for k, c in enumerate(known.free)} if known else {}
    new = [c for c in free if c.name not in have]
    moved = []
    steps = []
    for c in new:
        step = STEP * c.scale if x[c.name] + STEP * c.scale <= c.high else -STEP * c.scale
        steps.append(step / c.scale)
        moved.append({**x, c.name: x[c.name] + step})
    models = problem.models(structure, moved)
    now = problem.measured - rows
    columns = dict(have)
    for c, model, step in zip(new, models, steps, strict=True):
        columns[c.name] = (model - now) / step
    return np.column_stack([columns[c.name] for c in free])


def _prior_cost(free: Sequence[Coordinate], x: Mapping[str, float]) -> float:
    return sum(((x[c.name] - c.start) / c.prior) ** 2 for c in free if c.prior)


def _step(
    free: Sequence[Coordinate], x: Mapping[str, float], jacobian: Array, rows: Array, damping: float
) -> dict[str, float]:
    """The next coordinates: a damped Gauss-Newton step held within the bounds, active ones left out."""
    scale = np.array([c.scale for c in free])
    now = np.array([x[c.name] for c in free])
    low = (np.array([c.low for c in free]) - now) / scale
    high = (np.array([c.high for c in free]) - now) / scale
    prior = np.array([(c.scale / c.prior) ** 2 if c.prior else 0.0 for c in free])
    pull = np.array([(c.start - x[c.name]) / c.scale if c.prior else 0.0 for c in free]) * prior
    normal = jacobian.T @ jacobian + np.diag(prior)
    right = jacobian.T @ rows + pull
    normal = normal + np.diag(damping * np.diag(normal) + 1e-9)
    step = np.zeros(len(free))
    held = np.zeros(len(free), bool)
    for _ in range(len(free)):
        loose = ~held
        if not loose.any():
            break
        reduced = right[loose] - normal[np.ix_(loose, held)] @ step[held]
        step[loose] = np.linalg.solve(normal[np.ix_(loose, loose)], reduced)
        over = loose & ((step < low - 1e-12) | (step > high + 1e-12))
        if not over.any():
            break
        worst = np.argmax(np.where(over, np.maximum(low - step, step - high), -1.0))
        step[worst] = np.clip(step[worst], low[worst], high[worst])
        held[worst] = True
    step = np.clip(step, low, high)
    return {**x, **{c.name: float(v) for c, v in zip(free, now + step * scale, strict=True)}}
