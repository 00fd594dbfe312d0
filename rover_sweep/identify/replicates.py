"""Replicates of measured responses: the model's answer to the measured steering plus fresh noise,

taken through the windows and the composite of the real data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.identify.fit import Condition
from rover_sweep.identify.forced_response import forced_response
from rover_sweep.identify.grouping import Group
from rover_sweep.identify.noise import CoarseTransformer, ResidualSpectra, fresh_noise
from rover_sweep.identify.recording import Array, Recording, Signal
from rover_sweep.identify.response import RISING, composite, transformed
from rover_sweep.identify.spectra import Complex, Transformer, WindowSpectra
from rover_sweep.identify.structure import ModelStructure

MARGIN = 1.15  # noise is made up to this times the highest frequency, and a few bins of the shortest window


@dataclass(frozen=True, eq=False)
class Replicates:
    """Of one output: log_ratio (count, n) = ln(replicate/model) at the points of the fit; coherence alike."""

    output: str
    log_ratio: Complex
    coherence: Array


class RunReplicator:
    """One run: its windows, the transforms of its steering, and what is shared by all models."""

    def __init__(self, run: Recording, windows: Sequence[float], w: Array, outputs: Sequence[str]) -> None:
        self.run, self.w, self.outputs = run, w, outputs
        self.transform = Transformer(*run.span, windows, w)
        self.steering = self.transform(run.manoeuvre("delta"))
        self.w_top = MARGIN * float(w[-1]) + 4 * 2 * np.pi / min(windows)
        self.residual_spectra = ResidualSpectra(run.span, self.w_top)
        self.coarse = CoarseTransformer(run.span, self.transform.windows, w, self.w_top)

    def spectra(
        self, structure: ModelStructure, condition: Condition, count: int, rng: np.random.Generator
    ) -> list[tuple[Array, Array, Complex]]:
        """Per window length: sums of |X|^2 (n_w,), |Y|^2 (count, n_outputs, n_w) and conj(X) Y."""
        answers, residuals = self._answers(structure, condition)
        noise = fresh_noise(
            self.residual_spectra(residuals), self.coarse.t, self.w_top, count,
            [o == "p" for o in self.outputs], rng,
        )  # fmt: skip
        made = self.coarse(noise.reshape(-1, noise.shape[-1]))
        shape = (-1, count, len(self.outputs), self.w.size)
        model = [np.array(parts).swapaxes(0, 1) for parts in zip(*map(self.transform, answers), strict=True)]
        return [
            _sums(x, y[:, None] + n.reshape(shape))
            for x, y, n in zip(self.steering, model, made, strict=True)
        ]

    def _answers(self, structure: ModelStructure, condition: Condition) -> tuple[list[Signal], list[Signal]]:
        """What is transformed of the model's answers, and the residuals of the measured channels."""
        run = self.run
        answers = forced_response(
            structure, condition.speed, run.manoeuvre("delta"), run.span, self.outputs,
            float(self.w[-1]), condition.filters,
        )  # fmt: skip
        made, residuals = [], []
        for output in self.outputs:
            channel = "vy" if output == "vydot" else output
            measured = run.manoeuvre(channel)
            y = answers[output].on(measured.t)
            residuals.append(replace(measured, x=measured.x - y))
            copy = replace(run, channels={**run.channels, channel: replace(measured, x=y)})
            made.append(transformed(copy, output))
        return made, residuals


def _sums(x: Complex, y: Complex) -> tuple[Array, Array, Complex]:
    """x (n_windows, n_w), y (n_windows, count, n_outputs, n_w)."""
    cross = np.einsum("kw,kbow->bow", x.conj(), y)
    power = np.einsum("kbow,kbow->bow", y.real, y.real) + np.einsum("kbow,kbow->bow", y.imag, y.imag)
    return np.sum(np.abs(x) ** 2, axis=0), power, cross


class GroupReplicator:
    """The runs of one speed: replicates of the responses that a fit used, for any model."""

    def __init__(self, group: Group, condition: Condition) -> None:
        self.condition = condition
        self.responses = [group.responses[d.output] for d in condition.data]
        first = self.responses[0]
        self.grid = first.w
        self.kept = np.unique(np.concatenate([_around(self.grid, d.w) for d in condition.data]))
        self.windows = first.windows
        self.total = sum(run.span[1] - run.span[0] for run in group.runs)
        outputs = [d.output for d in condition.data]
        w = self.grid[self.kept]
        self.runs = [RunReplicator(run, self.windows, w, outputs) for run in group.runs]

    def __call__(
        self, structure: ModelStructure, count: int, rng: np.random.Generator
    ) -> tuple[Replicates, ...]:
        """`count` replicates of the responses that the structure has."""
        per_run = [run.spectra(structure, self.condition, count, rng) for run in self.runs]
        w = self.grid[self.kept]
        spectra = [
            self._averaged(length, [parts[i] for parts in per_run], w, self._count(i))
            for i, length in enumerate(self.windows)
        ]
        xx, yy, xy = (g.reshape(count, -1, w.size) for g in composite(spectra))
        coherence = np.abs(xy) ** 2 / (xx * yy)
        return tuple(
            self._at_points(k, structure, xy[:, k] / xx[:, k], coherence[:, k])
            for k in range(len(self.condition.data))
        )

    def _count(self, i: int) -> int:
        return sum(run.transform.windows[i][0].size for run in self.runs)

    def _averaged(
        self, length: float, parts: Sequence[tuple[Array, Array, Complex]], w: Array, count: int
    ) -> WindowSpectra:
        """Flattened to one axis (replicate, output, w), for `composite` asks nothing of the others."""
        resolved = w >= 2 * np.pi / length * (1 - 1e-9)
        scale = 2.0 / length / count * np.where(resolved, 1.0, np.nan)
        yy = scale * sum(p[1] for p in parts)
        xx = np.broadcast_to(scale * sum(p[0] for p in parts), yy.shape)
        xy = scale * sum(p[2] for p in parts)
        return WindowSpectra(
            length, np.broadcast_to(w, yy.shape).ravel(), xx.ravel(), yy.ravel(), xy.ravel(),
            averages=self.total / length,
        )  # fmt: skip

    def _at_points(self, k: int, structure: ModelStructure, h: Complex, coherence: Array) -> Replicates:
        """Interpolated over log w as `FrequencyResponse.at` does it."""
        data, c = self.condition.data[k], self.condition
        w = self.grid[self.kept]
        rise = 1j * w if data.output in RISING else 1.0
        model = structure.response(w, c.speed, data.output, c.filters)
        exact = structure.response(data.w, c.speed, data.output, c.filters)
        x, grid = np.log(data.w), np.log(w)
        chord = np.interp(x, grid, np.log(np.abs(model)) + 1j * np.unwrap(np.angle(model)))
        bend = np.log(np.exp(chord) / exact)
        left = np.clip(np.searchsorted(grid, x, "right") - 1, 0, w.size - 2)
        share = (x - grid[left]) / (grid[left + 1] - grid[left])
        ratio = np.log(h * rise / model)

        def between(y: np.ndarray) -> np.ndarray:
            return y[:, left] * (1 - share) + y[:, left + 1] * share

        return Replicates(data.output, between(ratio) + bend, np.clip(between(coherence), 0.0, 1.0))


def _around(grid: Array, w: Array) -> np.ndarray:
    """Indices of the grid's neighbours of every w."""
    left = np.clip(np.searchsorted(grid, w, "right") - 1, 0, grid.size - 2)
    return np.concatenate((left, left + 1))
