"""All runs of one diagnosis as one least-squares problem with whitened rows.

A row is the real or imaginary part of one Fourier line of one channel's tapered signal, over the standard
deviation of the noise there. Noise of the one-sided density S [unit^2/Hz] puts the variance
S rate/4 sum(taper^2) into each part of a line, so a residual row is about N(0, 1) where the model is right
and neighbouring lines are nearly independent.

Tolerances that every rover has add s a to the rows, a ~ N(0, 1), s (size, k) their signatures. The residual
then has the covariance I + s s^T. `Metric` multiplies rows by its inverse square root, so that noise and
tolerances count the same and ordinary least squares is the maximum likelihood again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.noise_floor import TOP, Floor, floor_of
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import logged, motion_coordinates, motions, weigh_into
from rover_sweep.spectra.side_by_side import side_by_side

LOWEST = {"r": 0.0, "ay": 0.0, "p": 0.1, "vy": 0.5}  # Hz; below about 3 rad/s the GPS distorts the EKF's V_y
HIGHEST = {"vy": 5.0}  # Hz
FAINT = 1e-3  # variance of a tolerance in units of the noise, below which it changes rows by 0.05 % of them
MEANS = {"r": 0.004, "ay": 0.12}  # accuracy of a run's mean: gyro drift [rad/s], uneven ground [m/s^2]


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of one channel of one run.

    run: index. bins (k,) of its transform, f (k,) Hz, weight (k,) 1/(standard deviation of a part of the
    line). start: index of its first row; k real parts come before k imaginary ones.
    """

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
class Directions:
    """(I + s s^T)^(-1/2) = I + s inner s^T, in which noise and some tolerances count the same.

    s (rows, k): orthogonal combinations of the tolerances' rows at one standard deviation, if their square
    g^2 is above `FAINT`. inner (k, k): diagonal, h(g^2) with h(x) = (1/sqrt(1 + x) - 1)/x.
    """

    s: Array
    inner: Array
    single: NDArray[np.float32]

    @staticmethod
    def of_columns(s: Array) -> Directions:
        """Those of tolerances whose rows at one standard deviation are the columns of s (rows, k)."""
        square, v = np.linalg.eigh(s.T @ s)
        kept = square > FAINT
        square, turned = square[kept], s @ v[:, kept]
        inner = np.diag(np.expm1(-0.5 * np.log1p(square)) / square)
        return Directions(turned, inner, turned.astype(np.float32))

    def of(self, rows: Array) -> Array:
        """Rows (n,) or (n, k) with these tolerances."""
        return rows + self.s @ (self.inner @ (self.s.T @ rows))

    def of_small(self, rows: Array) -> Array:
        """Like `of` to seven digits, for differences of rows: half the data and half the time."""
        along = self.inner @ (self.single.T @ rows.astype(np.float32)).astype(np.float64)
        return rows + self.single @ along.astype(np.float32)


@dataclass(frozen=True, eq=False)
class Metric:
    """Noise and normal tolerances count the same in it: those of each run, then the shared ones.

    own: {rows of a run: its tolerances}. With W of the own ones, W (I + sum of own s s^T) W^T = I, so the
    shared ones have the rows W s. So work and memory grow with the number of runs, not with its square.
    """

    own: tuple[tuple[slice, Directions], ...]
    shared: Directions

    @staticmethod
    def of_columns(shared: Array, own: Sequence[tuple[slice, Array]] = ()) -> Metric:
        """The metric of tolerances whose rows at one standard deviation are the columns of shared (rows, k),
        and of own (rows of the run, k)."""
        found = tuple((rows, Directions.of_columns(s)) for rows, s in own)
        turned = shared.copy()
        for rows, directions in found:
            turned[rows] = directions.of(shared[rows])
        return Metric(found, Directions.of_columns(turned))

    def of(self, rows: Array) -> Array:
        """Rows (n,) or (n, k) in the metric."""
        out = rows.copy()
        for of, directions in self.own:
            out[of] = directions.of(rows[of])
        return self.shared.of(out)

    def of_small(self, rows: Array) -> Array:
        """Like `of` to seven digits, for differences of rows."""
        out = rows.copy()
        for of, directions in self.own:
            out[of] = directions.of_small(rows[of])
        return self.shared.of_small(out)


class Stopped(Exception):
    """A simulation was requested after the search was stopped."""


def never() -> bool:
    """False: the search is never stopped."""
    return False


@dataclass(frozen=True, eq=False)
class Problem:
    """Runs, their noise floor and the rows that compare them with a model.

    measured (size,): whitened rows of the recordings in the metric; plain_measured (size,): without it. stop:
    True lets each further simulation raise `Stopped`, so that a search ends at once.
    """

    runs: tuple[Experiment, ...]
    floor: Floor
    rows: tuple[Rows, ...]
    measured: Array
    plain_measured: Array
    metric: Metric | None = None
    stop: Callable[[], bool] = field(default=never, kw_only=True)

    @property
    def size(self) -> int:
        """Number of rows."""
        return self.measured.size

    def model(self, model: Model, x: Mapping[str, float]) -> Array:
        """The model's whitened rows (size,). x: {coordinate: value, SI units}."""
        return self._of_model(self.plain_models(model, [x])[0])

    def residual(self, model: Model, x: Mapping[str, float]) -> Array:
        """Whitened rows (size,), measured minus model."""
        return self.measured - self.model(model, x)

    def plain_models(self, model: Model, xs: Sequence[Mapping[str, float]]) -> list[Array]:
        """The model's whitened rows (size,) without the metric for each set of coordinates, on two threads.

        Sets that differ only in the sensors share one motion.
        """
        alike: dict[frozenset[tuple[str, float]], list[int]] = {}
        for k, x in enumerate(xs):
            alike.setdefault(frozenset(motion_coordinates(model, x).items()), []).append(k)
        drives = [(run, which) for run in range(len(self.runs)) for which in alike.values()]

        def of(pair: Sequence[tuple[int, Sequence[int]]]) -> list[tuple[int, int, Array]]:
            if self.stop():
                raise Stopped
            moved = motions([(self.runs[run], xs[which[0]]) for run, which in pair], model)
            found = []
            for (run, which), one in zip(pair, moved, strict=True):
                own, rows = self.runs[run], [row for row in self.rows if row.run == run]
                found += [(k, run, whitened_run(rows, own, logged(own, model, xs[k], one))) for k in which]
            return found

        pairs = [drives[k : k + 2] for k in range(0, len(drives), 2)]
        out: list[list[Array]] = [[np.empty(0)] * len(self.runs) for _ in xs]
        for found in side_by_side(of, pairs):
            for k, run, rows in found:
                out[k][run] = rows
        return [np.concatenate(rows) for rows in out]

    def of(self, rows: Array) -> Array:
        """Whitened rows (size,) or (size, k) in the metric of this problem."""
        return self.metric.of(rows) if self.metric else rows

    def of_columns(self, rows: Array) -> Array:
        """Many small rows (size, k) in the metric, to seven digits."""
        return self.metric.of_small(rows) if self.metric else rows

    def models(self, model: Model, xs: Sequence[Mapping[str, float]]) -> list[Array]:
        """The model's rows for several sets of coordinates; the metric is applied to all at once."""
        found = self.plain_models(model, xs)
        if len(found) < 2 or self.metric is None:
            return [self._of_model(rows) for rows in found]
        return list(self._of_model(np.column_stack(found)).T)

    def _of_model(self, rows: Array) -> Array:
        """Rows (size,) or (size, k) of models in the metric, by their small differences from the data."""
        if self.metric is None:
            return rows
        turn = (slice(None), None) if rows.ndim == 2 else slice(None)
        return self.measured[turn] + self.metric.of_small(rows - self.plain_measured[turn])

    def in_metric(self, shared: Array, own: Sequence[Array] = ()) -> Problem:
        """The same problem with tolerances: their rows at one standard deviation as columns.

        shared (size, k): of all runs; own: of each run (its rows, k), in order.
        """
        metric = Metric.of_columns(shared, [(self.rows_of(run), s) for run, s in enumerate(own) if s.size])
        return replace(self, measured=metric.of(self.plain_measured), metric=metric)

    def rows_of(self, run: int) -> slice:
        """The rows of a run, by its index."""
        own = [row for row in self.rows if row.run == run]
        return slice(own[0].start, own[-1].start + own[-1].size) if own else slice(0, 0)

    @property
    def plain(self) -> Problem:
        """The same problem without tolerances."""
        return replace(self, measured=self.plain_measured, metric=None)

    def steadied(self, model: Model, x: Mapping[str, float]) -> Problem:
        """The problem with `Experiment.steadied` runs and the same residual at x.

        The measured rows change as the model at x does.
        """
        other = replace(self, runs=tuple(run.steadied(x.get("speed_share", 1.0)) for run in self.runs))
        changed = self.plain_models(model, [x])[0] - other.plain_models(model, [x])[0]
        measured = self.plain_measured - changed
        return replace(other, plain_measured=measured, measured=self.of(measured))

    def part(self, rows: Array, run: int | None = None, channel: str | None = None) -> Array:
        """The part of rows (size,) of one run and channel (None: all)."""
        parts = [
            rows[r.start : r.start + r.size]
            for r in self.rows
            if run in (None, r.run) and channel in (None, r.channel)
        ]
        return np.concatenate(parts) if parts else np.empty(0)


def problem(runs: Sequence[Experiment], residuals: Sequence[Mapping[str, Array]]) -> Problem:
    """Builds the Problem; the residuals {channel: (n,)} of a first fit give its noise floor."""
    return with_floor(runs, floor_of(runs, residuals))


def with_floor(
    runs: Sequence[Experiment], floor: Floor, levels: Sequence[Mapping[str, float]] = ()
) -> Problem:
    """Builds the Problem from runs and their noise floor.

    levels: {channel: noise power over the floor's} of each run; () where the floor is that of all.
    """
    rows, start = list[Rows](), 0
    for k, run in enumerate(runs):
        f: Array = np.asarray(np.fft.rfftfreq(run.t.size, 1 / RATE), np.float64)
        energy = np.sum(run.taper**2)
        for channel in run.measured:
            tops = TOP, 0.4 * run.rates.get(channel, RATE), HIGHEST.get(channel, TOP)
            top = min(*tops, 0.5 * run.steer_rate + 2.0, floor.top.get(channel, TOP))
            chosen = np.flatnonzero((f >= max(LOWEST[channel], 0.6 / run.t[-1])) & (f <= top))
            level = levels[k].get(channel, 1.0) if levels else 1.0
            weight = 1.0 / np.sqrt(level * floor.at(channel, f[chosen]) * RATE / 4 * energy)
            if channel in MEANS:
                chosen = np.concatenate(([0], chosen))
                weight = np.concatenate(([1.0 / (MEANS[channel] * np.sum(run.taper))], weight))
            rows.append(Rows(k, channel, chosen, f[chosen], weight, start))
            start += rows[-1].size
    data = [centred(run) for run in runs]
    measured = whitened(tuple(rows), runs, data)
    return Problem(tuple(runs), floor, tuple(rows), measured, measured)


def centred(run: Experiment) -> dict[str, Array]:
    """Measurements {channel: (n,)} minus the gyro biases at standstill; the bias of a_y is a coordinate."""
    return {c: x - (run.at_rest.get(c, 0.0) if c in ("r", "p") else 0.0) for c, x in run.measured.items()}


def signals_left(run: Experiment, model: Model, x: Mapping[str, float]) -> dict[str, Array]:
    """Measurements minus model {channel: (n,)}, SI units."""
    log = logged(run, model, x)
    return {c: y - log[c] for c, y in centred(run).items()}


def whitened(rows: Sequence[Rows], runs: Sequence[Experiment], logs: Sequence[Mapping[str, Array]]) -> Array:
    """Whitened rows (size,) of signals {channel: (n,)} of each run, without a metric."""
    each = zip(runs, logs, strict=True)
    parts = [whitened_run([r for r in rows if r.run == k], run, log) for k, (run, log) in enumerate(each)]
    return np.concatenate(parts) if parts else np.empty(0)


def whitened_run(rows: Sequence[Rows], run: Experiment, log: Mapping[str, Array]) -> Array:
    """Like `whitened` for one run; rows: its own, in order."""
    if not rows:
        return np.empty(0)
    out = np.empty(sum(row.size for row in rows))
    lines = rfft(np.stack([log[row.channel] for row in rows]) * run.taper, overwrite_x=True)
    end = 0
    for row, found in zip(rows, lines, strict=True):
        weigh_into(found, row.bins, row.weight, out[end : end + row.size])
        end += row.size
    return out
