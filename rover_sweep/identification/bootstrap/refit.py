"""The fit of a model to many replicates of its own responses, from its optimum, all at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.identification.bootstrap.replicates import Replicates
from rover_sweep.identification.cost import PHASE_WEIGHT, POINTS, Condition
from rover_sweep.identification.structure.state_space import ModelStructure
from rover_sweep.spectra.response import Band
from rover_sweep.spectra.spectra import Complex

STEPS = 8  # Gauss-Newton steps a replicate at most
SETTLED = 1e-6  # of the cost: a step that promises to gain less is the last


def refitted(
    structure: ModelStructure, conditions: Sequence[Condition], made: Sequence[Sequence[Replicates]]
) -> Array:
    """The fit to every replicate (count, n_free) by Gauss-Newton from the optimum, nan where it ran off.

    made: of each condition, in the order of its data. Residuals are exact, sensitivities linear in the
    parameters; the bands and weights are each replicate's own.
    """
    parts = [(c, r) for c, replicates in zip(conditions, made, strict=True) for r in replicates]
    around = _Surroundings(structure, parts)
    theta = np.full((len(parts[0][1].bands), len(structure.free)), np.nan)
    alike: dict[tuple[Band | None, ...], list[int]] = {}
    for i, bands in enumerate(zip(*(r.bands for _, r in parts), strict=True)):
        alike.setdefault(bands, []).append(i)
    for bands, rows in alike.items():
        known = [b for b in bands if b is not None]
        if len(known) == len(parts):
            theta[rows] = _descended(around, known, np.array(rows))
    return theta


def logarithmic(structure: ModelStructure) -> np.ndarray:
    """Which of the free parameters are positive, and fitted as logarithms."""
    return np.array([p.lower > 0 for p in structure.free])


@dataclass(frozen=True, eq=False)
class _Points:
    """One response at the points of its fit: where they lie in the grid, the data and the model there."""

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
    """As `fit.sampled`: interpolated over log w in dB and unwrapped phase."""
    w = np.geomspace(*band, POINTS)
    x, grid = np.log(w), np.log(r.w)
    left = np.clip(np.searchsorted(grid, x, "right") - 1, 0, r.w.size - 2)
    share = (x - grid[left]) / (grid[left + 1] - grid[left])
    bare = structure.response(w, condition.speed, r.output)
    known = condition.filters.get(r.output)
    exact = bare * known.response(w) if known else bare
    empty = _Points(condition, r.output, w, left, share, r.log_model, w, bare)
    bend = np.log(np.exp(empty.between(r.log_model)) / exact)
    coherence = np.clip(empty.between(r.coherence[rows]), 0.0, 1.0)
    weight = 20.0 / POINTS * (1.58 * (1.0 - np.exp(-coherence))) ** 2
    ratio = empty.between(r.log_ratio[rows]) + bend
    return _Points(condition, r.output, w, left, share, ratio, weight, bare)


def _descended(around: _Surroundings, bands: Sequence[Band], rows: np.ndarray) -> Array:
    """Parameters (n_rows, n_free) of the replicates `rows`, which have these bands."""
    points = [_points(around.structure, c, r, b, rows) for (c, r), b in zip(around.parts, bands, strict=True)]
    path = _Path(around, points)
    data = _stacked([p.log_ratio for p in points])
    weight = np.concatenate([np.tile(p.weight, 2) for p in points], axis=1)
    x, left = np.zeros((rows.size, around.start.size)), data.copy()
    moving = np.arange(rows.size)
    for _ in range(STEPS):
        step, gain = _step(path.sensitivities(x[moving]), weight[moving], left[moving])
        x[moving] = around.inside(x[moving] + step)
        cost = np.sum(weight[moving] * left[moving] ** 2, axis=1)
        moving = moving[~(gain <= SETTLED * cost)]
        if not moving.size:
            break
        left[moving] = data[moving] - path.moved(x[moving])
    theta = around.theta(x)
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


class _Surroundings:
    """The model around its optimum on the grids of the replicates, in x = ln(theta/theta^) of positive

    parameters and theta - theta^ of the others: sensitivities of ln H, and how they change with x.
    """

    def __init__(self, structure: ModelStructure, parts: Sequence[tuple[Condition, Replicates]]) -> None:
        self.structure, self.parts = structure, parts
        self.start, self.lower, self.upper = (
            np.array([(p.value, p.lower, p.upper) for p in structure.free], dtype=float).reshape(-1, 3).T
        )
        self.log = logarithmic(structure)
        self.slope = self._slopes(np.zeros(self.start.size))
        bends = [self._bends(e) for e in np.eye(self.start.size)]
        self.bend = [np.array([b[k] for b in bends]) for k in range(len(parts))]

    def theta(self, x: Array) -> Array:
        """Parameter values (..., n_free)."""
        return np.where(self.log, self.start * np.exp(np.where(self.log, x, 0.0)), self.start + x)

    def inside(self, x: Array) -> Array:
        """x with every parameter within its bounds."""
        small = np.where(self.log, np.clip(x, -50, 50), x)
        theta = np.clip(self.theta(small), self.lower, self.upper)
        return np.where(self.log, np.log(np.where(self.log, theta / self.start, 1.0)), theta - self.start)

    def at(self, x: Array) -> ModelStructure:
        """The structure at x (n_free,)."""
        names = [p.name for p in self.structure.free]
        return self.structure.with_values(dict(zip(names, self.theta(x), strict=True)))

    def _slopes(self, x: Array) -> list[Complex]:
        """d ln H / dx (n_free, n_w) of each response."""
        structure, scale = self.at(x), np.where(self.log, self.theta(x), 1.0)
        return [(structure.log_sensitivity(r.w, c.speed, r.output) * scale).T for c, r in self.parts]

    def _bends(self, direction: Array) -> list[Complex]:
        h = 1e-4 * direction * np.where(self.log, 1.0, np.abs(self.start) + 1e-3)
        pairs = zip(self._slopes(h), self._slopes(-h), strict=True)
        return [(after - before) / (2 * np.sum(h)) for after, before in pairs]


class _Path:
    """The model at the points of one choice of bands, in [dB, weighted deg] of every response."""

    def __init__(self, around: _Surroundings, points: Sequence[_Points]) -> None:
        self.around, self.points = around, points
        self.slope = _stacked([p.between(s) for p, s in zip(points, around.slope, strict=True)]).T
        self.bend = np.swapaxes(
            _stacked([p.between(b) for p, b in zip(points, around.bend, strict=True)]), 1, 2
        )

    def sensitivities(self, x: Array) -> Array:
        """d / dx (count, n, n_free), to first order in x (count, n_free)."""
        return self.slope + np.einsum("bq,qnp->bnp", x, self.bend)

    def moved(self, x: Array) -> Array:
        """By how much (count, n) the model at x (count, n_free) has moved; the low-passes cancel."""
        models = [self.around.at(row) for row in x]
        return _stacked(
            [
                np.log(np.array([m.response(p.w, p.condition.speed, p.output) for m in models]) / p.model)
                for p in self.points
            ]
        )


def _stacked(logs: Sequence[np.ndarray]) -> Array:
    """[dB, weighted deg] of every response, along the last axis."""
    parts = []
    for z in logs:
        parts += [z.real * 20 / np.log(10), np.degrees(z.imag) * np.sqrt(PHASE_WEIGHT)]
    return np.concatenate(parts, axis=-1)
