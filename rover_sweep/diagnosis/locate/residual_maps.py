"""What a model leaves of a recording, in sizes of the noise: by band, and over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc, ndtr

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.noise_floor import quiet_frames
from rover_sweep.diagnosis.problem.residuals import Problem, Rows
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment

PLAIN = 2**0.5  # rms over noise, from which a place is worth telling: as much again as the noise
FRAME = 1.4  # variance of the floor from one quiet frame, relative
SURE = 4.0  # standard deviations, beyond which it is no chance
CHANCE = float(ndtr(-SURE))
EDGES: Array = np.geomspace(0.3, 76.0, 17)  # rad/s, half octaves


@dataclass(frozen=True, eq=False)
class Residual:
    """One channel of one run, whitened by the noise floor.

    x (n,): measured less model on the run's grid; noise (n,): variance of x from noise alone, which the
    taper brings down at both ends; density: one-sided variance per Hz of noise between the ends; low, high
    [rad/s]: the band that is in it.
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
    """The channel's residual in each run that has it; rows (size,): measured less model."""
    return [_residual(problem, rows, r) for r in problem.rows if r.channel == channel and np.any(r.bins > 0)]


def _residual(problem: Problem, rows: Array, r: Rows) -> Residual:
    run = problem.runs[r.run]
    n, energy = run.t.size, float(np.sum(run.taper**2))
    lines = np.zeros(n // 2 + 1, complex)
    part = rows[r.start : r.start + r.size]
    lines[r.bins] = part[: r.bins.size] + 1j * part[r.bins.size :]
    lines[0] = 0.0  # known to another accuracy than the noise: see `steady`
    inside = r.bins > 0
    noise = 4 * inside.sum() / n * run.taper**2 / energy
    w = 2 * np.pi * np.arange(n // 2 + 1) * RATE / n
    low, high = float(w[r.bins[inside][0]]), float(w[r.bins[-1]])
    return Residual(r.run, run, r.channel, np.fft.irfft(lines, n), noise, 4 / (RATE * energy), low, high)


def spectrum(
    problem: Problem, rows: Array, channel: str, edges: Array, run: int | None = None
) -> tuple[Array, Array]:
    """(mean square (k,) of the rows between the edges (k+1,) [rad/s], number of rows there (k,))."""
    total, count = np.zeros(edges.size - 1), np.zeros(edges.size - 1)
    for r in problem.rows:
        if r.channel != channel or run not in (None, r.run):
            continue
        part = rows[r.start : r.start + r.size]
        k = np.searchsorted(edges, 2 * np.pi * r.f, "right") - 1
        inside = (k >= 0) & (k < total.size) & (r.f > 0)
        squares = part[: r.bins.size] ** 2 + part[r.bins.size :] ** 2
        np.add.at(total, k[inside], squares[inside])
        np.add.at(count, k[inside], 2.0)
    return total / np.maximum(count, 1.0), count


def floor_error(problem: Problem, edges: Array) -> Array:
    """Relative standard deviation (k,) of the noise floor between the edges (k+1,) [rad/s].

    A frame counts less than its two numbers, as frames overlap, and more, as frequencies are pooled;
    measured on white noise the error squared is 1.4 over the frames where they are fewest, 0.9 elsewhere.
    """
    f, frames = quiet_frames(problem.runs)
    middle = np.sqrt(edges[1:] * edges[:-1]) / (2 * np.pi)
    return np.sqrt(FRAME / np.maximum(np.interp(middle, f, frames), 1.0))


def clear(power: float, count: float, floor: float = 0.0) -> bool:
    """True where a mean square over `count` rows is plainly and surely above the noise, 1.

    floor: relative standard deviation of that noise, which makes it an F test.
    """
    return bool(power > PLAIN**2 and fdtrc(count, 2.0 / max(floor, 1e-3) ** 2, power) < CHANCE)


@dataclass(frozen=True, eq=False)
class Explained:
    """What some signals take off a channel's residual beside others.

    amounts (k,) of the signals, errors (k,) their standard deviations, sizes (k,): signed rms of each in the
    rows in which it is, in noise; drop of the sum of squares; ratio: rms over noise in those rows.
    """

    amounts: Array
    errors: Array
    sizes: Array
    drop: float
    ratio: float


Signals = Callable[[Experiment], Mapping[str, Array]]


def explained(
    problem: Problem, rows: Array, channel: str, beside: Signals, added: Signals, run: int | None = None
) -> Explained | None:
    """Least squares of the channel's rows on signals {name: (n,)} of each run; None where they are nought.

    beside: signals whose part is not counted; added: those that are looked for. run: only this one.
    """
    target = problem.part(rows, run, channel)
    base, more = (_columns(problem, channel, s, run) for s in (beside, added))
    q, _ = np.linalg.qr(base)
    left, seen = target - q @ (q.T @ target), more - q @ (q.T @ more)
    gram = seen.T @ seen
    if np.any(np.diag(gram) < 1e-6 * np.maximum(np.sum(more**2, axis=0), 1e-12)):
        return None
    amounts = np.linalg.solve(gram, seen.T @ left)
    drop = float(left @ (seen @ amounts))
    spread = max(1.0, float(left @ left - drop) / max(target.size - base.shape[1] - more.shape[1], 1))
    power = np.sum(seen**2, axis=1)
    count = float(np.sum(power) ** 2 / np.sum(power**2))
    errors: Array = np.sqrt(np.diag(np.linalg.inv(gram)) * spread)
    sizes = amounts * np.sqrt(np.sum(more**4, axis=0) / np.sum(more**2, axis=0))
    return Explained(np.asarray(amounts), errors, sizes, drop / spread, float(np.sqrt(1.0 + drop / count)))


def _columns(problem: Problem, channel: str, signals: Signals, only: int | None) -> Array:
    """Rows (m, k) of signals, whitened as the channel's residual is."""
    parts = []
    for r in problem.rows:
        if r.channel == channel and only in (None, r.run):
            run = problem.runs[r.run]
            lines = [np.fft.rfft(y * run.taper)[r.bins] * r.weight for y in signals(run).values()]
            parts.append(np.column_stack([np.concatenate((x.real, x.imag)) for x in lines]))
    return np.concatenate(parts)


def channels_of(problem: Problem) -> Sequence[str]:
    """The channels that were compared, each once."""
    return list(dict.fromkeys(r.channel for r in problem.rows))
