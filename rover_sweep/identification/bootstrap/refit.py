"""Refits of a model to many replicates of its responses at once, by Gauss-Newton from its optimum.

The residuals are those of `identification.cost`, exact at every step: e = 20/ln 10 Re, 180/pi Im of
ln(H_replicate/H_model), weighted. The sensitivities S(x) = d ln H/dx are expanded once about the optimum,
S(x) = S_0 + sum_q x_q dS/dx_q, with x = ln(theta/theta^) of positive parameters and theta - theta^ of the
others; so a step needs no derivatives of the model. Step: (S^T W S) dx = S^T W e.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.identification.bootstrap.replicates import Replicates
from rover_sweep.identification.cost import PHASE_WEIGHT, POINTS, Condition
from rover_sweep.identification.structure.state_space import ModelStructure
from rover_sweep.spectra.response import Band
from rover_sweep.spectra.windowed import Complex

MAX_STEPS = 8  # most Gauss-Newton steps of a replicate
TINY = 1e-300  # of a positive parameter without a lower bound
CONVERGED = 1e-6  # of the cost: converged when the predicted gain of a step is smaller


def refitted_replicates(
    structure: ModelStructure, conditions: Sequence[Condition], replicates: Sequence[Sequence[Replicates]]
) -> Array:
    """theta_b (count, n_free) in parameter units, nan in rows that did not converge or lack a usable band.

    replicates: per condition, one for each response in the order of its data. Each replicate has its own
    bands and coherence weights.
    """
    parts = [(c, r) for c, responses in zip(conditions, replicates, strict=True) for r in responses]
    expansion = _Expansion(structure, parts)
    theta = np.full((len(parts[0][1].bands), len(structure.free)), np.nan)
    with_bands: dict[tuple[Band | None, ...], list[int]] = {}
    for i, bands in enumerate(zip(*(r.bands for _, r in parts), strict=True)):
        with_bands.setdefault(bands, []).append(i)
    for bands, rows in with_bands.items():
        known = [b for b in bands if b is not None]
        if len(known) == len(parts):
            theta[rows] = _refit(expansion, known, np.array(rows))
    return theta


def logarithmic(structure: ModelStructure) -> np.ndarray:
    """Mask (n_free,) of the positive parameters, which are fitted as logarithms."""
    return np.array([p.lower > 0 for p in structure.free])


@dataclass(frozen=True, eq=False)
class _Points:
    """One response at the n points of its fit, w (n,) rad/s, for k replicates.

    left (n,), share (n,): index and weight of linear interpolation in the replicates' grid. log_ratio (k, n)
    = ln(replicate/model); weight (k, n) of the cost; model (n,): response without the sensor's low-pass.
    """

    condition: Condition
    output: str
    w: Array
    left: np.ndarray
    share: Array
    log_ratio: Complex
    weight: Array
    model: Complex

    def between(self, y: np.ndarray) -> np.ndarray:
        """y (..., n_w) at the points, linear over log w."""
        return y[..., self.left] * (1 - self.share) + y[..., self.left + 1] * self.share


def _points(
    structure: ModelStructure, condition: Condition, r: Replicates, band: Band, rows: np.ndarray
) -> _Points:
    """The points as `cost.sampled` takes them: interpolated over log w in dB and unwrapped phase.

    `interpolation_error` corrects log_ratio: the data are interpolated from the grid, the model is exact.
    """
    w = np.geomspace(*band, POINTS)
    x, grid = np.log(w), np.log(r.w)
    left = np.clip(np.searchsorted(grid, x, "right") - 1, 0, r.w.size - 2)
    share = (x - grid[left]) / (grid[left + 1] - grid[left])
    bare = structure.response(w, condition.speed, r.output)
    known = condition.filters.get(r.output)
    exact = bare * known.response(w) if known else bare
    empty = _Points(condition, r.output, w, left, share, r.log_model, w, bare)
    interpolation_error = np.log(np.exp(empty.between(r.log_model)) / exact)
    coherence = np.clip(empty.between(r.coherence[rows]), 0.0, 1.0)
    weight = 20.0 / POINTS * (1.58 * (1.0 - np.exp(-coherence))) ** 2
    ratio = empty.between(r.log_ratio[rows]) + interpolation_error
    return _Points(condition, r.output, w, left, share, ratio, weight, bare)


def _refit(expansion: _Expansion, bands: Sequence[Band], rows: np.ndarray) -> Array:
    """theta_b (n_rows, n_free) of the replicates `rows`, which share these bands."""
    points = [
        _points(expansion.structure, c, r, b, rows) for (c, r), b in zip(expansion.parts, bands, strict=True)
    ]
    model = _PointModel(expansion, points)
    data = _stacked([p.log_ratio for p in points])
    weight = np.concatenate([np.tile(p.weight, 2) for p in points], axis=1)
    x, residual = np.zeros((rows.size, expansion.start.size)), data.copy()
    moving = np.arange(rows.size)
    for _ in range(MAX_STEPS):
        slope = model.sensitivities(x[moving])
        step, _ = _step(slope, weight[moving], residual[moving])
        # a parameter at its bound that the step would push beyond stays there, and no longer counts
        blocked = (step != 0) & (expansion.within_bounds(x[moving] + step) == x[moving])
        step, gain = _step(np.where(blocked[:, None, :], 0.0, slope), weight[moving], residual[moving])
        x[moving] = expansion.within_bounds(x[moving] + step)
        cost = np.sum(weight[moving] * residual[moving] ** 2, axis=1)
        moving = moving[~(gain <= CONVERGED * cost)]
        if not moving.size:
            break
        residual[moving] = data[moving] - model.log_change(x[moving])
    theta = expansion.theta(x)
    theta[moving] = np.nan
    return theta


def _step(slope: Array, weight: Array, residual: Array) -> tuple[Array, Array]:
    """The Gauss-Newton step (count, n_free) and its predicted decrease of the cost (count,)."""
    weighted = np.swapaxes(slope * weight[:, :, None], 1, 2)
    gradient = (weighted @ residual[..., None])[..., 0]
    normal = weighted @ slope
    ridge = 1e-12 * np.einsum("bpp->bp", normal) + 1e-30  # for a parameter without effect on the data
    normal = normal + ridge[:, :, None] * np.eye(slope.shape[2])
    step: Array = np.linalg.solve(normal, gradient[..., None])[..., 0]
    return step, np.sum(step * gradient, axis=1)


class _Expansion:
    """The model about its optimum, expanded in x (see the module's text).

    slope: S_0 (n_free, n_w) of each response on its grid; curvature: dS/dx (n_free, n_free, n_w).
    """

    def __init__(self, structure: ModelStructure, parts: Sequence[tuple[Condition, Replicates]]) -> None:
        self.structure, self.parts = structure, parts
        self.start, self.lower, self.upper = (
            np.array([(p.value, p.lower, p.upper) for p in structure.free], dtype=float).reshape(-1, 3).T
        )
        self.log = logarithmic(structure)
        self.slope = self._slopes(np.zeros(self.start.size))
        curvatures = [self._curvature(e) for e in np.eye(self.start.size)]
        self.curvature = [np.array([b[k] for b in curvatures]) for k in range(len(parts))]

    def theta(self, x: Array) -> Array:
        """Parameter values theta (..., n_free) at x (..., n_free)."""
        return np.where(self.log, self.start * np.exp(np.where(self.log, x, 0.0)), self.start + x)

    def within_bounds(self, x: Array) -> Array:
        """x (..., n_free), clipped to the parameters' bounds."""
        start = np.where(self.log, self.start, 1.0)
        low, high = (
            np.where(self.log, np.log(np.maximum(bound, TINY) / start), bound - self.start)
            for bound in (self.lower, self.upper)
        )
        return np.clip(x, low, high)

    def at(self, x: Array) -> ModelStructure:
        """The structure at x (n_free,)."""
        names = [p.name for p in self.structure.free]
        return self.structure.with_values(dict(zip(names, self.theta(x), strict=True)))

    def _slopes(self, x: Array) -> list[Complex]:
        """d ln H / dx (n_free, n_w) of each response."""
        structure, scale = self.at(x), np.where(self.log, self.theta(x), 1.0)
        return [(structure.log_sensitivity(r.w, c.speed, r.output) * scale).T for c, r in self.parts]

    def _curvature(self, direction: Array) -> list[Complex]:
        """Derivative of the sensitivities along one parameter, by central differences."""
        h = 1e-4 * direction * np.where(self.log, 1.0, np.abs(self.start) + 1e-3)
        pairs = zip(self._slopes(h), self._slopes(-h), strict=True)
        return [(after - before) / (2 * np.sum(h)) for after, before in pairs]


class _PointModel:
    """The model at the points of one set of bands, in [dB, weighted deg] of every response (n in total)."""

    def __init__(self, expansion: _Expansion, points: Sequence[_Points]) -> None:
        self.expansion, self.points = expansion, points
        self.slope = _stacked([p.between(s) for p, s in zip(points, expansion.slope, strict=True)]).T
        self.curvature = np.swapaxes(
            _stacked([p.between(b) for p, b in zip(points, expansion.curvature, strict=True)]), 1, 2
        )

    def sensitivities(self, x: Array) -> Array:
        """S(x) (count, n, n_free), to first order in x (count, n_free)."""
        return self.slope + np.einsum("bq,qnp->bnp", x, self.curvature)

    def log_change(self, x: Array) -> Array:
        """ln(H(x)/H(0)) (count, n) at x (count, n_free), exact; the sensors' low-passes cancel."""
        models = [self.expansion.at(row) for row in x]
        return _stacked(
            [
                np.log(np.array([m.response(p.w, p.condition.speed, p.output) for m in models]) / p.model)
                for p in self.points
            ]
        )


def _stacked(logs: Sequence[np.ndarray]) -> Array:
    """Complex logarithms as [dB, weighted deg] of every response, along the last axis."""
    parts = []
    for z in logs:
        parts += [z.real * 20 / np.log(10), np.degrees(z.imag) * np.sqrt(PHASE_WEIGHT)]
    return np.concatenate(parts, axis=-1)
