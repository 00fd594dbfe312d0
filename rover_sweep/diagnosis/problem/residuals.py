"""All runs of one diagnosis as one least-squares problem: whitened residuals of a model's coordinates.

A row is the real or imaginary part of one line of one channel's tapered residual over the size of the
noise there, so that each row is about N(0, 1) where the model is right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.noise_floor import Floor, floor_of
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import Sensors, Structure, logged

TOP = 12.0  # Hz
LOWEST = {"r": 0.0, "ay": 0.0, "p": 0.1, "vy": 0.5}  # Hz; the GPS bends the EKF's V_y below about 3 rad/s
HIGHEST = {"vy": 5.0}
MEANS = {"r": 0.004, "ay": 0.12}  # what the mean of a run is known to: gyro drift [rad/s], unevenness [m/s^2]


@dataclass(frozen=True, eq=False)
class Rows:
    """Where the rows of one channel of one run are: bins (k,) of its transform, their weights (k,)."""

    run: int
    channel: str
    bins: NDArray[np.intp]
    f: Array
    weight: Array
    start: int

    @property
    def size(self) -> int:
        """Number of rows."""
        return 2 * self.bins.size


@dataclass(frozen=True, eq=False)
class Metric:
    """(I + S S^T)^(-1/2): rows in which noise and what an ordinary rover does anyhow count the same.

    u (rows, k): orthonormal directions of S; shrink (k,): what remains of a row along each, less 1.
    """

    u: Array
    shrink: Array

    @staticmethod
    def of_directions(s: Array) -> Metric:
        """The metric of nuisances whose rows at one standard deviation are the columns of s (rows, k)."""
        u, size, _ = np.linalg.svd(s, full_matrices=False)
        return Metric(u, 1.0 / np.sqrt(1.0 + size * size) - 1.0)

    def of(self, rows: Array) -> Array:
        """Rows (n,) or (n, k) in the metric."""
        along = self.u.T @ rows
        return rows + self.u @ (self.shrink[:, None] * along if along.ndim == 2 else self.shrink * along)


@dataclass(frozen=True, eq=False)
class Problem:
    """Runs, their noise floor and the rows that compare them with a model."""

    runs: tuple[Experiment, ...]
    sensors: tuple[Sensors, ...]
    floor: Floor
    rows: tuple[Rows, ...]
    measured: Array
    plain_measured: Array
    metric: Metric | None = None

    @property
    def size(self) -> int:
        """Number of rows."""
        return self.measured.size

    def model(self, structure: Structure, x: Mapping[str, float]) -> Array:
        """What the model puts into the rows (size,)."""
        logs = [logged(run, structure, x, s) for run, s in zip(self.runs, self.sensors, strict=True)]
        return self.of(whitened(self.rows, self.runs, logs))

    def of(self, rows: Array) -> Array:
        """Whitened rows (size,) or (size, k) in the metric of this problem."""
        return self.metric.of(rows) if self.metric else rows

    def models(self, structure: Structure, xs: Sequence[Mapping[str, float]]) -> list[Array]:
        """The rows of several coordinates at once, on two threads."""
        if len(xs) < 2:
            return [self.model(structure, x) for x in xs]
        with ThreadPoolExecutor(2) as pool:
            return list(pool.map(lambda x: self.model(structure, x), xs))

    def in_metric(self, s: Array) -> Problem:
        """The same problem with the nuisances whose rows at one standard deviation are columns of s."""
        metric = Metric.of_directions(s)
        return replace(self, measured=metric.of(self.plain_measured), metric=metric)

    @property
    def plain(self) -> Problem:
        """The same problem without nuisances."""
        return replace(self, measured=self.plain_measured, metric=None)

    def part(self, rows: Array, run: int | None = None, channel: str | None = None) -> Array:
        """The rows of one run and channel (None: all)."""
        parts = [
            rows[r.start : r.start + r.size]
            for r in self.rows
            if run in (None, r.run) and channel in (None, r.channel)
        ]
        return np.concatenate(parts) if parts else np.empty(0)


def over_noise(gain: float, rows: Array) -> float:
    """Rms over the noise of the rows on which a signature of shape `rows` stands, whose fit takes `gain`.

    1 where the signature is zero: a fit that moved nothing explains nothing.
    """
    peak = float(np.max(np.abs(rows), initial=0.0))
    if peak == 0.0:
        return 1.0
    square = (rows / peak) ** 2
    spread = float(np.sum(square) ** 2 / np.sum(square**2))  # rows over which it is spread
    return float(np.sqrt(1.0 + max(gain, 0.0) / spread))


def problem(runs: Sequence[Experiment], residuals: Sequence[Mapping[str, Array]]) -> Problem:
    """The problem of runs whose noise floor is taken from the residuals {channel: (n,)} of a first fit."""
    return with_floor(runs, floor_of(runs, residuals))


def with_floor(runs: Sequence[Experiment], floor: Floor) -> Problem:
    """The problem of runs in a noise floor that is known."""
    rows, start = [], 0
    for k, run in enumerate(runs):
        for channel in run.measured:
            found = _rows(run, k, channel, floor, start)
            rows.append(found)
            start += found.size
    data = [centred(run) for run in runs]
    sensors = tuple(Sensors.of(run) for run in runs)
    measured = whitened(tuple(rows), runs, data)
    return Problem(tuple(runs), sensors, floor, tuple(rows), measured, measured)


def centred(run: Experiment) -> dict[str, Array]:
    """Measurements less the gyros' biases at standstill; that of the accelerometer is a coordinate."""
    return {c: x - (run.at_rest.get(c, 0.0) if c in ("r", "p") else 0.0) for c, x in run.measured.items()}


def _rows(run: Experiment, index: int, channel: str, floor: Floor, start: int) -> Rows:
    f: Array = np.asarray(np.fft.rfftfreq(run.t.size, 1 / RATE), np.float64)
    top = min(TOP, 0.4 * run.rates.get(channel, RATE), HIGHEST.get(channel, TOP), 0.5 * run.steer_rate + 2.0)
    chosen = np.flatnonzero((f >= max(LOWEST[channel], 0.6 / run.t[-1])) & (f <= top))
    energy = np.sum(run.taper**2)
    weight = 1.0 / np.sqrt(floor.at(channel, f[chosen]) * RATE / 4 * energy)
    if channel in MEANS:
        chosen = np.concatenate(([0], chosen))
        weight = np.concatenate(([1.0 / (MEANS[channel] * np.sum(run.taper))], weight))
    return Rows(index, channel, chosen, f[chosen], weight, start)


def whitened(rows: Sequence[Rows], runs: Sequence[Experiment], logs: Sequence[Mapping[str, Array]]) -> Array:
    """Rows (size,) of signals {channel: (n,)} per run."""
    parts = []
    for row in rows:
        run = runs[row.run]
        lines = rfft(logs[row.run][row.channel] * run.taper)[row.bins] * row.weight
        parts += [lines.real, lines.imag]
    return np.concatenate(parts)
