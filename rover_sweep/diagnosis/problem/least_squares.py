"""Least squares of a model with bounds and priors, to a stationary point.

The problem: minimise over the free coordinates x, low <= x <= high,

    cost(x) = |y - f(x)|^2 + t sum over coordinates with a prior ((x_k - start_k)/prior_k)^2

t = `COARSE`: no model is exact, so a row counts less than an independent measurement. The likelihood is taken
to the power 1/t (Miller and Dunson 2019, J. Am. Stat. Assoc. 114); a prior is not. A cost over t is then
twice a negative log of a probability.

y: whitened measured rows, f(x): the model's rows. With r = y - f(x), the scaled step h_k = dx_k/scale_k, the
Jacobian J (size, k) of f by x/scale, and W = t diag((scale/prior)^2), the drop of the cost by a step is about

    2 h^T (J^T r + W (start - x)/scale) - h^T (J^T J + W + S) h

S is the curvature of the rows times the residual, which counts where a model is far off; it is learnt from
the Jacobians that a fit computes (Dennis, Gay and Welsch 1981). Each step has the largest drop of all steps
within the bounds, found exactly (Stark and Parker 1995), with damping diag(J^T J + W) added where a step did
not bring what was expected (Marquardt 1963). After each step the Jacobian takes in how the rows changed
(Broyden 1965). Where it predicts badly, or nothing more, it is computed again, near the end by differences to
both sides. A fit is finished when a Jacobian computed at x expects a drop below `FINISHED` of a row's
variance, a sixtieth of a standard deviation. So its result does not depend on the way there.

The derivatives are those of steadied runs, whose speed has no error (`Experiment.steadied`), at the residual
of the runs as they are. The runs are steadied again with each Jacobian.

Broyden 1965: A class of methods for solving nonlinear simultaneous equations, Math. Comp. 19.
Dennis, Gay and Welsch 1981: An adaptive nonlinear least-squares algorithm, ACM TOMS 7(3).
Marquardt 1963: An algorithm for least-squares estimation of nonlinear parameters, J. SIAM 11(2).
Stark and Parker 1995: Bounded-variable least-squares, Computational Statistics 10 (scipy's `lsq_linear`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.problem.residuals import Problem, whitened_run
from rover_sweep.diagnosis.simulation.candidates import DEGREES_OF_FREEDOM, Coordinate, Model
from rover_sweep.diagnosis.simulation.experiment import SPEED_ERROR
from rover_sweep.diagnosis.simulation.simulator import FittedModel, logged
from rover_sweep.spectra.side_by_side import side_by_side

COARSE = 6.0
"""Rows that count as one; with `posterior.weights` it has the best mean log score on drawn rovers."""
FAR_OFF = 1.5  # mean square of a row from which a fit is far off
WEAK = 1e-9  # information on a coordinate without a prior, so that a singular problem can be inverted
FINISHED, ROUGH = 3e-4, 1.0  # drop of the cost over a row's variance below which a fit is finished
TRUSTED = 0.25  # share of the expected drop from which a Jacobian serves for one more step
UNEXPECTED = 0.1  # least share that a new Jacobian expects of the drops that follow, in 300 fits from afar
LEAST_DAMPING = 1e-3
FIRST_DAMPING = 0.1  # of a look
MOST, LOOK = 100, 6  # most steps of a fit, and of a look at where a start leads
AT_BOUND = 1e-6  # of a coordinate's scale: nearer to a bound, it is at the bound


@dataclass(frozen=True, eq=False)
class Fitted(FittedModel):
    """A model fitted to a problem.

    free: the k fitted coordinates. cost: sum of squares of rows and priors. rows (size,): whitened residual,
    measured minus model. jacobian (size, k): derivatives of the model's rows by the coordinates over their
    scales, at x. finished: x is a stationary point.
    """

    free: tuple[Coordinate, ...]
    cost: float
    rows: Array
    jacobian: Array
    finished: bool = False

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

    @property
    def far_off(self) -> bool:
        """True if its residual is no noise."""
        return self.overdispersion >= FAR_OFF


def fit(
    problem: Problem,
    model: Model,
    start: Mapping[str, float],
    free: Sequence[Coordinate] | None = None,
    known: Fitted | None = None,
    roughly: bool = False,
    useful: float = inf,
) -> Fitted:
    """Least squares over the free coordinates from `start` {coordinate: value}; None: those of the model.

    known: a fit nearby, whose derivatives the first steps take for the coordinates that both have. roughly:
    finished at `ROUGH`. useful: a cost above which the fit does not matter; it ends where a new Jacobian
    expects less than `UNEXPECTED` of the way there.
    """
    free = model.free if free is None else tuple(free)
    x = {**start, **{c.name: float(np.clip(start.get(c.name, c.start), c.low, c.high)) for c in free}}
    least = ROUGH if roughly else FINISHED
    here = _derived(problem, model, free, x, known)
    last, bend = here if known is None else None, np.zeros((len(free), len(free)))
    fresh, both_sides, damping, unfinished = known is None, roughly, 0.0, roughly
    for _ in range(MOST):
        trial, expected = _step(free, here, damping, bend)
        nothing_left = expected < least * here.variance
        if fresh and nothing_left and both_sides:
            break
        if fresh and here.cost - expected / UNEXPECTED > useful:
            unfinished = True
            break
        if not nothing_left:
            there = here.moved(model, free, trial)
            as_expected = here.cost - there.cost > TRUSTED * expected
            if there.cost < here.cost:
                here = there
            elif fresh:
                damping = max(10.0 * damping, LEAST_DAMPING)
                continue
            if as_expected:
                fresh, damping = False, damping / 10.0 if damping > LEAST_DAMPING else 0.0
                continue
        both_sides = roughly or expected < ROUGH * here.variance
        here, fresh = _derived(problem, model, free, here.x, None, both_sides and not roughly), True
        bend = _bent(bend, free, last, here) if last else bend
        last = here
    rows = here.rows if fresh else problem.residual(model, here.x)
    cost = float(rows @ rows + _prior_cost(free, here.x))
    return Fitted(model, here.x, free, cost, rows, here.jacobian, fresh and not unfinished)


def first_steps(problem: Problem, model: Model, start: Mapping[str, float], known: Fitted) -> Fitted:
    """Where a start leads: some steps of a fit with derivatives from nearby, which are not computed again."""
    free = model.free
    x = {**start, **{c.name: float(np.clip(start.get(c.name, c.start), c.low, c.high)) for c in free}}
    rows = problem.residual(model, x)
    jacobian = _jacobian(problem, model, free, x, rows, known, False)
    here = _Point(problem, x, rows, float(rows @ rows + _prior_cost(free, x)), jacobian)
    damping, bend = 0.0, np.zeros((len(free), len(free)))
    for _ in range(LOOK):
        there = here.moved(model, free, _step(free, here, damping, bend)[0])
        damping = damping / 10.0 if there.cost < here.cost else max(10.0 * damping, FIRST_DAMPING)
        here = there if there.cost < here.cost else here
    return Fitted(model, here.x, free, here.cost, here.rows, here.jacobian)


def sensitivities(problem: Problem, fitted: Fitted) -> Fitted:
    """The fit with a Jacobian computed at its own coordinates."""
    return replace(fitted, jacobian=_derived(problem, fitted.model, fitted.free, fitted.x, None).jacobian)


@dataclass(frozen=True, eq=False)
class _Point:
    """A place x of a fit. steady: the problem of steadied runs. rows (size,), jacobian (size, k): there."""

    steady: Problem
    x: Mapping[str, float]
    rows: Array
    cost: float
    jacobian: Array

    @property
    def variance(self) -> float:
        """Mean square of a row, at least 1."""
        return max(1.0, self.cost / self.rows.size)

    def moved(self, model: Model, free: Sequence[Coordinate], x: Mapping[str, float]) -> _Point:
        """The place x, with the nearest Jacobian that agrees with how the rows changed (Broyden 1965).

        Near: the squares of its change, each column in units of its own length.
        """
        rows = self.steady.residual(model, x)
        step = _steps(free, self.x, x)
        weighted = step * np.einsum("ij,ij->j", self.jacobian, self.jacobian)
        missing = self.rows - rows - self.jacobian @ step
        jacobian = self.jacobian + np.outer(missing, weighted / max(step @ weighted, 1e-300))
        cost = float(rows @ rows + _prior_cost(free, x))
        return replace(self, x=x, rows=rows, cost=cost, jacobian=jacobian)


def _derived(
    problem: Problem,
    model: Model,
    free: Sequence[Coordinate],
    x: Mapping[str, float],
    known: Fitted | None,
    both_sides: bool = False,
) -> _Point:
    """The place x with its Jacobian; known: with these derivatives from nearby."""
    rows, steady = problem.residual(model, x), problem.steadied(model, x)
    jacobian = _jacobian(steady, model, free, x, rows, known, both_sides)
    return _Point(steady, x, rows, float(rows @ rows + _prior_cost(free, x)), jacobian)


def _steps(free: Sequence[Coordinate], begin: Mapping[str, float], end: Mapping[str, float]) -> Array:
    """The way (k,) from one place to another, over the coordinates' scales."""
    return np.array([(end[c.name] - begin[c.name]) / c.scale for c in free])


def _bent(bend: Array, free: Sequence[Coordinate], before: _Point, now: _Point) -> Array:
    """The curvature (k, k), -sum of r_i f_i'', after a step, from the Jacobians at both of its ends.

    The nearest symmetric one that agrees with how J^T r changed by J, after it was made no larger along the
    step than that (Dennis, Gay and Welsch 1981).
    """
    step = _steps(free, before.x, now.x)
    seen = (before.jacobian - now.jacobian).T @ now.rows
    slope = before.jacobian.T @ before.rows - now.jacobian.T @ now.rows + prior_information(free) * step
    along = float(slope @ step)
    if along <= 0.0:
        return bend
    old = float(step @ bend @ step)
    bend = bend * min(1.0, abs(float(seen @ step) / old)) if old else bend
    missing = seen - bend @ step
    both = np.outer(missing, slope) / along
    return np.asarray(bend + both + both.T - float(missing @ step) * np.outer(slope, slope) / along**2)


def _jacobian(
    problem: Problem,
    model: Model,
    free: Sequence[Coordinate],
    x: Mapping[str, float],
    rows: Array,
    known: Fitted | None,
    both_sides: bool,
) -> Array:
    """Derivatives (size, k) by difference quotients: to one side, or to both within the bounds."""
    columns = {c.name: known.jacobian[:, k] for k, c in enumerate(known.free)} if known else {}
    columns |= {c.name: np.zeros(problem.size) for c in free if c.step == 0.0}
    places = list[tuple[Coordinate, list[float]]]()
    for c in free:
        if c.name not in columns:
            ends = [s for s in (c.step * c.scale, -c.step * c.scale) if c.low <= x[c.name] + s <= c.high]
            places.append((c, (ends or [c.step * c.scale])[: 2 if both_sides else 1]))
    moved = [{**x, c.name: x[c.name] + step} for c, steps in places for step in steps]
    models = iter(problem.models(model, moved))
    now = problem.measured - rows
    for c, steps in places:
        slopes = [(next(models) - now) / (step / c.scale) for step in steps]
        columns[c.name] = np.mean(slopes, axis=0)
    return np.column_stack([columns[c.name] for c in free])


def prior_information(free: Sequence[Coordinate], absent: float = 0.0) -> Array:
    """W (k,) of the coordinates' priors, in their scales; absent: value without prior."""
    return np.array([COARSE * (c.scale / c.prior) ** 2 if c.prior else absent for c in free])


def _prior_cost(free: Sequence[Coordinate], x: Mapping[str, float]) -> float:
    return COARSE * sum(((x[c.name] - c.start) / c.prior) ** 2 for c in free if c.prior)


def _step(
    free: Sequence[Coordinate], here: _Point, damping: float, bend: Array
) -> tuple[dict[str, float], float]:
    """(the next coordinates, the drop of the cost that they should bring), see the module."""
    loose = [k for k, c in enumerate(free) if c.high > c.low]
    chosen, jacobian = [free[k] for k in loose], here.jacobian[:, loose]
    scale, now = (np.array(of) for of in zip(*((c.scale, here.x[c.name]) for c in chosen), strict=True))
    low, high = ((np.array([getattr(c, end) for c in chosen]) - now) / scale for end in ("low", "high"))
    prior = prior_information(chosen)
    pull = prior * np.array([(c.start - here.x[c.name]) / c.scale if c.prior else 0.0 for c in chosen])
    normal = jacobian.T @ jacobian + np.diag(prior)
    right = jacobian.T @ here.rows + pull
    size = np.sqrt(np.diag(normal) + WEAK)
    curved = normal + bend[np.ix_(loose, loose)]
    scaled = curved / np.outer(size, size)
    more = max(WEAK - float(np.linalg.eigvalsh(scaled)[0]), 0.0)  # a saddle: downhill all the same
    root = np.linalg.cholesky(scaled + (damping + 2.0 * more + WEAK) * np.eye(size.size))
    wanted = solve_triangular(root, right / size, lower=True)
    ends = np.minimum(low, 0.0) * size, np.maximum(high, 0.0) * size
    step = np.clip(lsq_linear(root.T, wanted, ends, "bvls").x / size, low, high)
    expected = float(step @ (2.0 * right - curved @ step))
    return {**here.x, **{c.name: float(v) for c, v in zip(chosen, now + step * scale, strict=True)}}, expected


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
    """One parameter of one effect: the whitened rows (n,) that `size` of its coordinate adds.

    run: index of the run whose rows they are; None: of all runs.
    """

    effect: str
    parameter: str
    size: float
    rows: Array
    run: int | None = None


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
    """Signatures of all runs as columns (size, k); zeros (size, 1) if none."""
    shared = [s.rows for s in found if s.run is None]
    return np.column_stack(shared) if shared else np.zeros((size, 1))


def columns_of_runs(problem: Problem, found: Sequence[Signature]) -> list[Array]:
    """Signatures of each run as columns (its rows, k)."""
    own = [[s.rows for s in found if s.run == run] for run in range(len(problem.runs))]
    return [np.column_stack(some) if some else np.empty((0, 0)) for some in own]


# The slow error of the measured speed, a nuisance of every recording.
#
# The model is driven by the speed that an EKF estimates from GPS and accelerometer. The error of that speed,
# 1 or 2 cm/s, drifts within seconds and multiplies the yaw rate. The residual that it causes grows with the
# amplitude and would look like an effect.


FASTEST = 0.3  # Hz; over shorter times the accelerometer determines the estimate


def speed_drift(problem: Problem, fitted: Fitted) -> list[Signature]:
    """Signatures of the speed error: each run's cosines and sines up to `FASTEST`, one standard deviation."""
    return [one for run in range(len(problem.runs)) for one in _of_run(problem, fitted, run)]


def with_speed_drift(problem: Problem, fitted: Fitted, times: float = 1.0) -> Problem:
    """The problem with that error alone as its tolerances, `times` as large."""
    own = [times * s for s in columns_of_runs(problem, speed_drift(problem, fitted))]
    return problem.in_metric(np.empty((problem.size, 0)), own)


def _of_run(problem: Problem, fitted: Fitted, index: int) -> Iterator[Signature]:
    run = problem.runs[index]
    rows = [r for r in problem.rows if r.run == index]
    now = logged(run, fitted.model, fitted.x)
    length = float(run.t[-1])
    waves = int(FASTEST * length)

    def signature(wave: tuple[int, float]) -> Signature:
        number, phase = wave
        error = SPEED_ERROR / np.sqrt(waves) * np.cos(2 * np.pi * number * run.t / length + phase)
        moved = logged(replace(run, speed=run.speed + error), fitted.model, fitted.x)
        change = {c: moved[c] - now[c] for c in moved}
        return Signature("speed", f"{run.name} {number}", SPEED_ERROR, whitened_run(rows, run, change), index)

    return side_by_side(signature, [(n, p) for n in range(1, waves + 1) for p in (0.0, 0.5 * np.pi)])
