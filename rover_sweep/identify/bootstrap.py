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
from dataclasses import dataclass

import numpy as np

from rover_sweep.identify.fit import PHASE_WEIGHT, Condition, FitResult
from rover_sweep.identify.grouping import Group
from rover_sweep.identify.recording import Array
from rover_sweep.identify.replicates import GroupReplicator, Replicates
from rover_sweep.identify.structure import ModelStructure, Parameter

LEVEL = 0.90
STEPS = 3  # Gauss-Newton steps a replicate, with the sensitivities of the optimum


@dataclass(frozen=True)
class Intervals:
    """Interval of one parameter at `level`, and the standard deviation of its estimate, in its unit.

    bias: how far the method itself puts the estimate from the truth; the interval has it taken out, so
    it need not hold the estimate. replicates: how many it rests on; failed: how many ran off.
    """

    name: str
    low: float
    high: float
    level: float
    sd: float
    bias: float
    replicates: int
    failed: int


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
        return refitted(fit.structure, [g.condition for g in self.groups], made)


def _interval(p: Parameter, log: bool, theta: Array, level: float, failed: int) -> Intervals:
    """The basic interval 2 theta^ - quantiles, on a log scale for positive parameters."""
    if theta.size < 2:
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
    """The fit to every replicate (count, n_free): Gauss-Newton from the optimum, its sensitivities kept.

    The weights are each replicate's own.
    """
    free, log = structure.free, _logarithmic(structure)
    names, start = [p.name for p in free], np.array([p.value for p in free])
    slope = _sensitivities(structure, conditions) * np.where(log, start, 1.0)
    data = _stacked([r.log_ratio for parts in made for r in parts])
    weight = np.concatenate([np.tile(_scale(r) ** 2, 2) for parts in made for r in parts], axis=1)
    normal = np.einsum("np,bn,nq->bpq", slope, weight, slope)
    x = np.zeros((len(data), len(free)))
    left = data
    for k in range(STEPS):
        x = x + np.linalg.solve(normal, ((weight * left) @ slope)[..., None])[..., 0]
        theta = np.where(log, start * np.exp(np.clip(x, -50, 50)), start + x)
        theta = np.clip(theta, [p.lower for p in free], [p.upper for p in free])
        if k < STEPS - 1:
            moved = [structure.with_values(dict(zip(names, row, strict=True))) for row in theta]
            left = data - np.array([_moved(structure, m, conditions) for m in moved])
    return theta


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


def _moved(base: ModelStructure, other: ModelStructure, conditions: Sequence[Condition]) -> Array:
    ratios = [
        np.log(other.response(d.w, c.speed, d.output) / base.response(d.w, c.speed, d.output))
        for c in conditions
        for d in c.data
    ]
    return _stacked(ratios)
