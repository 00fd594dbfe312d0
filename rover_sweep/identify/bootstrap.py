"""Intervals of the parameters by a parametric bootstrap through the whole pipeline.

Windows overlap by 80 %, several lengths share the same data and one run of 55 s holds two independent
windows of the longest length, so there is nothing to resample among windows. Instead the fitted model
is driven by the measured steering, noise with the cross-spectra of the fit's own residuals is added in
the time domain, and the responses, composites and parameters are estimated again. This keeps every
correlation (between windows, lengths, neighbouring frequencies and responses) and shows the bias of
the method itself, such as the leakage of the windows, which the intervals take out (basic bootstrap
intervals, Davison & Hinkley 1997, section 5.2). What a model does not explain counts as noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.identify.fit import PHASE_WEIGHT, Condition, FitResult, restricted
from rover_sweep.identify.grouping import Group
from rover_sweep.identify.intervals import LEVEL, Intervals
from rover_sweep.identify.recording import Array
from rover_sweep.identify.replicates import GroupReplicator, Replicates
from rover_sweep.identify.spectra import Complex
from rover_sweep.identify.structure import ModelStructure, Parameter

STEPS = 8  # Gauss-Newton steps a replicate at most
SETTLED = 1e-6  # of the cost: a step that promises to gain less is the last


class Bootstrap:
    """Replicates of the responses of these groups, to which any number of models can be fitted again."""

    def __init__(self, groups: Sequence[Group], conditions: Sequence[Condition]) -> None:
        self.groups = [GroupReplicator(g, c) for g, c in zip(groups, conditions, strict=True)]

    def intervals(
        self, fit: FitResult, replicates: int = 200, level: float = LEVEL, seed: int = 0
    ) -> tuple[Intervals, ...]:
        """Intervals of the free parameters of a fit to these very conditions; the same from the same seed."""
        thetas = self.estimates(fit, replicates, seed)
        free, log = fit.structure.free, _logarithmic(fit.structure)
        ok = np.all(np.isfinite(thetas), axis=1)
        return tuple(
            _interval(p, bool(log[i]), thetas[ok, i], level, int(np.sum(~ok))) for i, p in enumerate(free)
        )

    def estimates(self, fit: FitResult, replicates: int, seed: int) -> Array:
        """Estimates (replicates, n_free) of the free parameters, nan where one ran off."""
        rng = np.random.default_rng(seed)
        made = [group(fit.structure, replicates, rng) for group in self.groups]
        conditions = [restricted(g.condition, fit.structure) for g in self.groups]
        return refitted(fit.structure, conditions, made)


def _interval(p: Parameter, log: bool, theta: Array, level: float, failed: int) -> Intervals:
    """The basic interval 2 theta^ - quantiles, on a log scale for positive parameters."""
    if theta.size < max(2, failed):
        return Intervals(p.name, np.nan, np.nan, level, np.nan, np.nan, theta.size, failed)
    x, best = (np.log(theta), np.log(p.value)) if log else (theta, p.value)
    low, high = 2 * best - np.quantile(x, [(1 + level) / 2, (1 - level) / 2])
    ends = np.exp((low, high)) if log else np.array((low, high))
    low, high = np.clip(ends, p.lower, p.upper)
    sd, bias = float(np.std(theta, ddof=1)), float(np.mean(theta) - p.value)
    return Intervals(p.name, float(low), float(high), level, sd, bias, theta.size, failed)


def _logarithmic(structure: ModelStructure) -> np.ndarray:
    return np.array([p.lower > 0 for p in structure.free])


def refitted(
    structure: ModelStructure, conditions: Sequence[Condition], made: Sequence[Sequence[Replicates]]
) -> Array:
    """The fit to every replicate (count, n_free) by Gauss-Newton from the optimum, nan where it ran off.

    Residuals are exact, sensitivities linear in the parameters; the weights are each replicate's own.
    """
    path = _Path(structure, conditions)
    data = _stacked([r.log_ratio for parts in made for r in parts])
    weight = np.concatenate([np.tile(_scale(r) ** 2, 2) for parts in made for r in parts], axis=1)
    x, left = np.zeros((len(data), len(structure.free))), data.copy()
    moving = np.arange(len(data))
    for _ in range(STEPS):
        step, gain = _step(path.sensitivities(x[moving]), weight[moving], left[moving])
        x[moving] = path.inside(x[moving] + step)
        cost = np.sum(weight[moving] * left[moving] ** 2, axis=1)
        moving = moving[~(gain <= SETTLED * cost)]
        if not moving.size:
            break
        left[moving] = data[moving] - path.moved(x[moving])
    theta = path.theta(x)
    theta[moving] = np.nan
    return theta


def _step(slope: Array, weight: Array, left: Array) -> tuple[Array, Array]:
    """The Gauss-Newton step (count, n_free) and the cost (count,) that it promises to gain."""
    weighted = np.swapaxes(slope * weight[:, :, None], 1, 2)
    gradient = (weighted @ left[..., None])[..., 0]
    normal = weighted @ slope
    ridge = 1e-12 * np.einsum("bpp->bp", normal) + 1e-30  # for a parameter that the data do not see
    normal = normal + ridge[:, :, None] * np.eye(slope.shape[2])
    step: Array = np.linalg.solve(normal, gradient[..., None])[..., 0]
    return step, np.sum(step * gradient, axis=1)


class _Path:
    """The model around the optimum, in x = ln(theta/theta^) of positive parameters, theta - theta^ else."""

    def __init__(self, structure: ModelStructure, conditions: Sequence[Condition]) -> None:
        self.structure, self.conditions = structure, conditions
        self.start, self.lower, self.upper = np.array(
            [(p.value, p.lower, p.upper) for p in structure.free], dtype=float
        ).T
        self.log = _logarithmic(structure)
        self.answers = _answers(structure, conditions)
        self.slope = self._slope(np.zeros(self.start.size))
        self.bend = np.array([self._bend(e) for e in np.eye(self.start.size)])

    def theta(self, x: Array) -> Array:
        """Parameter values (..., n_free)."""
        return np.where(self.log, self.start * np.exp(np.where(self.log, x, 0.0)), self.start + x)

    def inside(self, x: Array) -> Array:
        """x with every parameter within its bounds."""
        theta = np.clip(self.theta(np.where(self.log, np.clip(x, -50, 50), x)), self.lower, self.upper)
        return np.where(self.log, np.log(np.where(self.log, theta / self.start, 1.0)), theta - self.start)

    def sensitivities(self, x: Array) -> Array:
        """d [dB, weighted deg] / dx (count, n, n_free), to first order in x (count, n_free)."""
        return self.slope + np.einsum("bq,qnp->bnp", x, self.bend)

    def moved(self, x: Array) -> Array:
        """[dB, weighted deg] (count, n) by which the model at x (count, n_free) has moved."""
        moved = [_answers(self._at(row), self.conditions) for row in x]
        return _stacked([np.log(np.array(h) / h0) for *h, h0 in zip(*moved, self.answers, strict=True)])

    def _at(self, x: Array) -> ModelStructure:
        names = [p.name for p in self.structure.free]
        return self.structure.with_values(dict(zip(names, self.theta(x), strict=True)))

    def _slope(self, x: Array) -> Array:
        sensitivities = _sensitivities(self._at(x), self.conditions)
        return sensitivities * np.where(self.log, self.theta(x), 1.0)

    def _bend(self, direction: Array) -> Array:
        h = 1e-4 * direction * np.where(self.log, 1.0, np.abs(self.start) + 1e-3)
        return (self._slope(h) - self._slope(-h)) / (2 * np.sum(h))


def _scale(r: Replicates) -> Array:
    """sqrt(20 W_gamma/n), as `fit.residuals`."""
    return np.sqrt(20.0 / r.coherence.shape[1]) * 1.58 * (1.0 - np.exp(-r.coherence))


def _stacked(logs: Sequence[np.ndarray]) -> Array:
    """[dB, weighted deg] of every response, along the last axis."""
    parts = []
    for z in logs:
        parts += [z.real * 20 / np.log(10), np.degrees(z.imag) * np.sqrt(PHASE_WEIGHT)]
    return np.concatenate(parts, axis=-1)


def _sensitivities(structure: ModelStructure, conditions: Sequence[Condition]) -> Array:
    logs = [structure.log_sensitivity(d.w, c.speed, d.output).T for c in conditions for d in c.data]
    return _stacked(logs).T


def _answers(structure: ModelStructure, conditions: Sequence[Condition]) -> list[Complex]:
    """Responses without the sensors' low-passes, which cancel in every ratio."""
    return [structure.response(d.w, c.speed, d.output) for c in conditions for d in c.data]
