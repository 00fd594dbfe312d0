"""The residual of a model in multiples of the noise: by band, over time, on signals, and in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import fdtrc, ndtr

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.noise_floor import quiet_frames
from rover_sweep.diagnosis.problem.residuals import Problem, Rows
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment

LARGE = 2**0.5  # rms over noise from which a place is reported: the misfit is then as large as the noise
SIGMAS = 4.0  # standard deviations from which a value is significant
EDGES: Array = np.geomspace(0.3, 76.0, 17)  # rad/s, half octaves


@dataclass(frozen=True, eq=False)
class Residual:
    """The whitened residual of one channel of one run.

    x (n,): measured minus model on the run's grid. noise (n,): variance of x by noise alone, smaller at both
    ends because of the taper. density: its one-sided variance per Hz between the ends. low, high [rad/s]: its
    band.
    """

    index: int
    run: Experiment
    channel: str
    x: Array
    noise: Array
    density: float
    low: float
    high: float


def residuals_of(problem: Problem, rows: Array, channel: str) -> list[Residual]:
    """The channel's residual in each run that has it; rows (size,): whitened, measured minus model."""
    return [_residual(problem, rows, r) for r in problem.rows if r.channel == channel and np.any(r.bins > 0)]


def _residual(problem: Problem, rows: Array, r: Rows) -> Residual:
    run = problem.runs[r.run]
    n, energy = run.t.size, float(np.sum(run.taper**2))
    lines = np.zeros(n // 2 + 1, complex)
    part = rows[r.start : r.start + r.size]
    lines[r.bins] = part[: r.bins.size] + 1j * part[r.bins.size :]
    lines[0] = 0.0  # the mean has another accuracy than the noise, see `steady`
    inside = r.bins > 0
    noise = 4 * inside.sum() / n * run.taper**2 / energy
    w = 2 * np.pi * np.arange(n // 2 + 1) * RATE / n
    low, high = float(w[r.bins[inside][0]]), float(w[r.bins[-1]])
    return Residual(r.run, run, r.channel, np.fft.irfft(lines, n), noise, 4 / (RATE * energy), low, high)


def spectrum(problem: Problem, rows: Array, channel: str, run: int | None = None) -> tuple[Array, Array]:
    """(mean square (k,), number (k,)) of the rows between the `EDGES` (k+1,)."""
    total, count = np.zeros(EDGES.size - 1), np.zeros(EDGES.size - 1)
    for r in problem.rows:
        if r.channel != channel or run not in (None, r.run):
            continue
        part = rows[r.start : r.start + r.size]
        k = np.searchsorted(EDGES, 2 * np.pi * r.f, "right") - 1
        inside = (k >= 0) & (k < total.size) & (r.f > 0)
        squares = part[: r.bins.size] ** 2 + part[r.bins.size :] ** 2
        np.add.at(total, k[inside], squares[inside])
        np.add.at(count, k[inside], 2.0)
    return total / np.maximum(count, 1.0), count


def floor_error(problem: Problem) -> Array:
    """Relative standard deviation (k,) of the noise floor between the `EDGES` (k+1,).

    Overlap of the frames increases it, smoothing over frequencies reduces it. Measured on white noise, its
    square is 1.4 over the number of frames where they are fewest, and 0.9 over it elsewhere.
    """
    f, frames = quiet_frames(problem.runs)
    middle = np.sqrt(EDGES[1:] * EDGES[:-1]) / (2 * np.pi)
    return np.sqrt(1.4 / np.maximum(np.interp(middle, f, frames), 1.0))


def above_noise(power: float, count: float, floor: float) -> bool:
    """True where a mean square over `count` rows is large and significantly above the noise, 1.

    floor: relative standard deviation of the noise floor. The test is an F test, since both are estimates.
    """
    chance = fdtrc(max(count, 1.0), 2.0 / max(floor, 1e-3) ** 2, power)
    return bool(power > LARGE**2 and chance < ndtr(-SIGMAS))


def rms_over_noise(power: Array, count: Array, chosen: Any) -> float:
    """Root of the mean of the chosen powers (k,) over noise, each of `count` (k,) rows."""
    return float(np.sqrt(np.sum((power * count)[chosen]) / np.sum(count[chosen])))


@dataclass(frozen=True, eq=False)
class SignalFit:
    """Least squares of a channel's residual on k signals.

    amounts (k,) and their standard deviations errors (k,). sizes (k,): signed rms over noise of each in the
    rows where it acts. drop: of the sum of squares, over the rows' variance. ratio: rms over noise in those
    rows.
    """

    amounts: Array
    errors: Array
    sizes: Array
    drop: float
    ratio: float


Signals = Callable[[Experiment], Mapping[str, Array]]


def fit_signals(
    problem: Problem, rows: Array, channel: str, nuisances: Signals, added: Signals, run: int | None = None
) -> SignalFit | None:
    """Least squares of the channel's rows on signals {name: (n,)} of each run; None where they are zero.

    nuisances: signals fitted too, but not counted; added: the signals of interest. run: only this one.
    """
    target = problem.part(rows, run, channel)
    base, more = (_columns(problem, channel, s, run) for s in (nuisances, added))
    q, _ = np.linalg.qr(base)
    remaining, own = target - q @ (q.T @ target), more - q @ (q.T @ more)
    gram = own.T @ own
    if np.any(np.diag(gram) < 1e-6 * np.maximum(np.sum(more**2, axis=0), 1e-12)):
        return None
    amounts = np.linalg.solve(gram, own.T @ remaining)
    drop = float(remaining @ (own @ amounts))
    spread = max(
        1.0, float(remaining @ remaining - drop) / max(target.size - base.shape[1] - more.shape[1], 1)
    )
    power = np.sum(own**2, axis=1)
    count = float(np.sum(power) ** 2 / np.sum(power**2))
    errors: Array = np.sqrt(np.diag(np.linalg.inv(gram)) * spread)
    sizes = amounts * np.sqrt(np.sum(more**4, axis=0) / np.sum(more**2, axis=0))
    return SignalFit(np.asarray(amounts), errors, sizes, drop / spread, float(np.sqrt(1.0 + drop / count)))


def _columns(problem: Problem, channel: str, signals: Signals, only: int | None) -> Array:
    """Rows (m, k) of signals, whitened like the channel's residual."""
    parts = []
    for r in problem.rows:
        if r.channel == channel and only in (None, r.run):
            run = problem.runs[r.run]
            lines = [np.fft.rfft(y * run.taper)[r.bins] * r.weight for y in signals(run).values()]
            parts.append(np.column_stack([np.concatenate((x.real, x.imag)) for x in lines]))
    return np.concatenate(parts)


def channel_name(channel: str) -> str:
    """A channel's name in a sentence."""
    return {"ay": "a_y", "vy": "V_y"}.get(channel, channel)


def rounded_band(low: float, high: float) -> tuple[float, float]:
    """A band [rad/s] with two digits."""
    return float(f"{low:.2g}"), float(f"{high:.2g}")


def noise_ratio(ratio: float) -> str:
    """A size in multiples of the noise."""
    return f"{ratio:.0f} times the noise" if ratio >= 10 else f"{ratio:.1f} times the noise"


def ordinal(k: int) -> str:
    """1st, 2nd, 3rd, 4th ..."""
    return str(k) + {1: "st", 2: "nd", 3: "rd"}.get(k, "th")
