"""Damped least squares of a model with bounds and priors.

The problem: minimise over the free coordinates x, low <= x <= high,

    cost(x) = |y - f(x)|^2 + t sum over coordinates with a prior ((x_k - start_k)/prior_k)^2

t = `COARSE`: no model is exact, so a row counts less than an independent measurement. The likelihood is taken
to the power 1/t (Miller and Dunson 2019, J. Am. Stat. Assoc. 114); a prior is not. A cost over t is then
twice a negative log of a probability.

y: whitened measured rows, f(x): the model's rows. With r = y - f(x), the scaled step h_k = dx_k/scale_k, the
Jacobian J (size, k) of f by x/scale, and W = t diag((scale/prior)^2), the linearised cost is minimal where

    (N + damping diag(N)) h = J^T r + W (start - x)/scale,   N = J^T J + W

This is the step of Gauss-Newton for damping -> 0 and a short step of steepest descent (in coordinates scaled
by diag(N)) for a large damping (Marquardt 1963; Nocedal and Wright 2006, section 10.3). A step that lowers
the cost is taken and the damping divided by 10, else the damping is multiplied by 10.

Bounds: where the step leaves them, the coordinate that leaves farthest is fixed at its bound and the others
are solved again, until all are inside. This is an active set method (Nocedal and Wright 2006, section 16.5)
without multipliers: all coordinates are free again at the beginning of the next step.

The derivatives are those of steadied runs, whose speed has no error (`Experiment.steadied`).

`known` keeps Jacobian columns of an earlier fit (a chord method, Kelley 1995, chapter 5): the limit is then
no exact minimum, so the gain is a lower bound until the fit goes on with a fresh Jacobian.

Marquardt 1963: An algorithm for least-squares estimation of nonlinear parameters, J. SIAM 11(2).
Nocedal and Wright 2006: Numerical Optimization, 2nd edition, Springer.
Kelley 1995: Iterative Methods for Linear and Nonlinear Equations, SIAM.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.problem.residuals import Problem, whitened
from rover_sweep.diagnosis.simulation.candidates import DEGREES_OF_FREEDOM, Coordinate, Model
from rover_sweep.diagnosis.simulation.experiment import SPEED_ERROR
from rover_sweep.diagnosis.simulation.simulator import FittedModel, logged
from rover_sweep.spectra.side_by_side import side_by_side

COARSE = 6.0
"""Rows that count as one; with `posterior.weights` it has the best mean log score on drawn rovers."""
WEAK = 1e-9  # information on a coordinate without a prior, so that a singular problem can be inverted
AT_BOUND = 1e-6  # of a coordinate's scale: nearer to a bound, it is at the bound


@dataclass(frozen=True, eq=False)
class Fitted(FittedModel):
    """A model fitted to a problem.

    free: the k fitted coordinates. cost: sum of squares of rows and priors. rows (size,): whitened residual,
    measured minus model. jacobian (size, k): derivatives of the model's rows by the coordinates over their
    scales. own: jacobian computed at or near x, not kept.
    """

    free: tuple[Coordinate, ...]
    cost: float
    rows: Array
    jacobian: Array
    own: bool = False

    @property
    def effects(self) -> frozenset[str]:
        """The ids of its effects, without those that its baseline has."""
        return frozenset(self.model.ids) - self.model.given

    @property
    def data_cost(self) -> float:
        """Sum of squares of the rows, without the priors."""
        return float(self.rows @ self.rows)

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(k,) True for the coordinates that are not at a bound."""
        return np.array(
            [c.low + AT_BOUND * c.scale < self.x[c.name] < c.high - AT_BOUND * c.scale for c in self.free]
        )

    @property
    def overdispersion(self) -> float:
        """Mean square of the residual rows, at least 1 (1 is the noise)."""
        return max(1.0, self.data_cost / self.rows.size)


def fit(
    problem: Problem,
    model: Model,
    start: Mapping[str, float],
    free: Sequence[Coordinate] | None = None,
    steps: int = 12,
    known: Fitted | None = None,
    tolerance: float = 1e-3,
) -> Fitted:
    """Least squares over the free coordinates from `start` {coordinate: value}; None: those of the model.

    steps: maximum number. known: a fit nearby. Its Jacobian is used for the coordinates that both have, so
    that only new ones cost simulations; `refit_candidates` goes on with a fresh one. tolerance: drop of the
    cost that ends the fit.
    """
    free = model.free if free is None else tuple(free)
    x = {**start, **{c.name: float(np.clip(start.get(c.name, c.start), c.low, c.high)) for c in free}}
    given, problem = problem, problem.steadied(model, x)
    rows = problem.residual(model, x)
    cost = rows @ rows + _prior_cost(free, x)
    damping = 1e-3
    jacobian = np.empty((problem.size, 0))
    for _ in range(steps):
        jacobian = _jacobian(problem, model, free, x, rows, known)
        improved = False
        for _ in range(5):
            trial = _step(free, x, jacobian, rows, damping)
            trial_rows = problem.residual(model, trial)
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
    rows = given.residual(model, x)
    return Fitted(model, x, free, float(rows @ rows + _prior_cost(free, x)), rows, jacobian)


def sensitivities(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with a Jacobian computed at its own coordinates."""
    steadied = problem.steadied(fitted.model, fitted.x)
    fresh = _jacobian(steadied, fitted.model, fitted.free, fitted.x, fitted.rows, None)
    return replace(fitted, jacobian=fresh, own=True)


def _jacobian(
    problem: Problem,
    model: Model,
    free: Sequence[Coordinate],
    x: Mapping[str, float],
    rows: Array,
    known: Fitted | None,
) -> Array:
    kept = {c.name: known.jacobian[:, k] * 1.0 for k, c in enumerate(known.free)} if known else {}
    kept |= {c.name: np.zeros(problem.size) for c in free if c.step == 0.0}
    new = [c for c in free if c.name not in kept]
    moved = []
    steps = []
    for c in new:
        step = c.step * c.scale if x[c.name] + c.step * c.scale <= c.high else -c.step * c.scale
        steps.append(step / c.scale)
        moved.append({**x, c.name: x[c.name] + step})
    now = problem.measured - rows
    columns = dict(kept)
    for c, found, step in zip(new, problem.models(model, moved), steps, strict=True):
        columns[c.name] = (found - now) / step
    return np.column_stack([columns[c.name] for c in free])


def prior_information(free: Sequence[Coordinate], absent: float = 0.0) -> Array:
    """W (k,) of the coordinates' priors, in their scales; absent: value without prior."""
    return np.array([COARSE * (c.scale / c.prior) ** 2 if c.prior else absent for c in free])


def _prior_cost(free: Sequence[Coordinate], x: Mapping[str, float]) -> float:
    return COARSE * sum(((x[c.name] - c.start) / c.prior) ** 2 for c in free if c.prior)


def _step(
    free: Sequence[Coordinate], x: Mapping[str, float], jacobian: Array, rows: Array, damping: float
) -> dict[str, float]:
    """The next coordinates: a damped Gauss-Newton step within the bounds, see the module."""
    scale = np.array([c.scale for c in free])
    now = np.array([x[c.name] for c in free])
    low = (np.array([c.low for c in free]) - now) / scale
    high = (np.array([c.high for c in free]) - now) / scale
    prior = prior_information(free)
    pull = np.array([(c.start - x[c.name]) / c.scale if c.prior else 0.0 for c in free]) * prior
    normal = jacobian.T @ jacobian + np.diag(prior)
    right = jacobian.T @ rows + pull
    normal = normal + np.diag(damping * np.diag(normal) + 1e-9)
    step = np.zeros(len(free))
    fixed = np.zeros(len(free), bool)
    for _ in range(len(free)):
        loose = ~fixed
        if not loose.any():
            break
        reduced = right[loose] - normal[np.ix_(loose, fixed)] @ step[fixed]
        step[loose] = np.linalg.solve(normal[np.ix_(loose, loose)], reduced)
        outside = loose & ((step < low - 1e-12) | (step > high + 1e-12))
        if not outside.any():
            break
        farthest = np.argmax(np.where(outside, np.maximum(low - step, step - high), -1.0))
        step[farthest] = np.clip(step[farthest], low[farthest], high[farthest])
        fixed[farthest] = True
    step = np.clip(step, low, high)
    return {**x, **{c.name: float(v) for c, v in zip(free, now + step * scale, strict=True)}}


def cost_of(problem: Problem, fitted: Fitted) -> float:
    """Sum of squares, in the metric of `problem`, of the residual of a model fitted in another metric."""
    rows = problem.residual(fitted.model, fitted.x)
    return float(rows @ rows)


# What each effect adds to the rows of a fitted model, and the score test made from it.
#
# The signature s of a parameter is the change of the model's whitened rows, f(x, size) - f(x, 0), for one
# size of it: a difference quotient of the rows times the size. Let r be the residual rows of the fit
# without the effect and P the projection onto the rows that the nominal coordinates cannot reach
# (`Tangent.outside`). To first order, the effect in the amount a (in sizes), with the nominal model
# refitted, leaves
#
#     |P (r - a s)|^2,   least for a = s^T P r / (s^T P s),   and lowers the cost by (s^T P r)^2 / (s^T P s)
#
# s^T P r is the score of the parameter and s^T P s its information after the nominal ones are estimated, so
# the drop is the score statistic of Rao (1948): chi-squared with one degree of freedom where the effect is
# absent and the noise is all there is. It needs no fit with the effect. For several parameters, with the
# columns S: r^T P S (S^T P S)^-1 S^T P r. `search.linear_prediction` computes it from the data,
# `plans.expected_posterior` what is expected of runs that are not driven.
#
# Rao 1948: Large sample tests of statistical hypotheses concerning several parameters, Math. Proc. Cambridge
# Philos. Soc. 44(1).


@dataclass(frozen=True, eq=False)
class Signature:
    """One parameter of one effect: the whitened rows (n,) that `size` of its coordinate adds."""

    effect: str
    parameter: str
    size: float
    rows: Array


def signatures(
    problem: Problem,
    base: Fitted,
    effects: Sequence[Effect],
    at: Mapping[str, float] | None = None,
    tolerances: bool = False,
) -> list[Signature]:
    """Signatures of effects at a fitted model; of an effect in one run (a change of ground) one per run.

    at: {coordinate: size}, by default the parameter's own size. tolerances: at each parameter's tolerance;
    none without one.
    """
    now = problem.model(base.model, base.x)
    wanted = [
        w
        for e in effects
        if e.id not in DEGREES_OF_FREEDOM
        for w in _wanted(problem, base, e, at or {}, tolerances)
    ]
    rows = side_by_side(lambda w: problem.model(w[3], w[4]) - now, wanted)
    return [Signature(e.id, p.name, size, r) for (e, p, size, _, _), r in zip(wanted, rows, strict=True)]


def _wanted(
    problem: Problem, base: Fitted, effect: Effect, at: Mapping[str, float], tolerances: bool
) -> list[tuple[Effect, EffectParameter, float, Model, dict[str, float]]]:
    out = []
    for run in problem.runs if effect.in_one_run else problem.runs[:1]:
        where = run.name if effect.in_one_run else ""
        model = base.model.with_effect(effect.name, where, run.order)
        for p in effect.parameters:
            name = effect.coordinate_name(p)
            size = p.tolerance if tolerances else at.get(name, p.size)
            if p.name == "t" or size == 0.0 or (tolerances and p.nominal):
                continue
            x = {**base.x, name: base.x.get(name, 0.0) + size}
            if effect.in_one_run:
                x[effect.key("t")] = at.get(effect.key("t"), 0.5 * float(run.t[-1]))
            out.append((effect, p, size, model, x))
    return out


def columns(found: Sequence[Signature], size: int) -> Array:
    """Signatures as columns (size, k); zeros (size, 1) if none."""
    return np.column_stack([s.rows for s in found]) if found else np.zeros((size, 1))


# The slow error of the measured speed, a nuisance of every recording.
#
# The model is driven by the speed that an EKF estimates from GPS and accelerometer. The error of that speed,
# 1 or 2 cm/s, drifts within seconds and multiplies the yaw rate. The residual that it causes grows with the
# amplitude and would look like an effect.


FASTEST = 0.3  # Hz; over shorter times the accelerometer determines the estimate


def speed_drift(problem: Problem, fitted: Fitted) -> list[Signature]:
    """Signatures of the speed error: each run's cosines and sines up to `FASTEST`, one standard deviation."""
    return [one for run in range(len(problem.runs)) for one in _of_run(problem, fitted, run)]


def _of_run(problem: Problem, fitted: Fitted, index: int) -> Iterator[Signature]:
    run = problem.runs[index]
    rows = tuple(r for r in problem.rows if r.run == index)
    now = logged(run, fitted.model, fitted.x)
    length = float(run.t[-1])
    waves = int(FASTEST * length)

    def signature(wave: tuple[int, float]) -> Signature:
        number, phase = wave
        error = SPEED_ERROR / np.sqrt(waves) * np.cos(2 * np.pi * number * run.t / length + phase)
        moved = logged(replace(run, speed=run.speed + error), fitted.model, fitted.x)
        change = {c: moved[c] - now[c] for c in moved}
        logs = [change if r == index else {} for r in range(len(problem.runs))]
        parts, start, column = whitened(rows, problem.runs, logs), 0, np.zeros(problem.size)
        for r in rows:
            column[r.start : r.start + r.size] = parts[start : start + r.size]
            start += r.size
        return Signature("speed", f"{run.name} {number}", SPEED_ERROR, column)

    return side_by_side(signature, [(n, p) for n in range(1, waves + 1) for p in (0.0, 0.5 * np.pi)])
