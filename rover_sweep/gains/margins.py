"""Gain and phase margin, crossover and bandwidth of a sampled loop from its frequency response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array

Complex = NDArray[np.complex128]
GAIN_MARGIN_DB, PHASE_MARGIN_DEG = 6.0, 45.0  # required of a proposal
POINTS = 240


@dataclass(frozen=True)
class Margins:
    """gain_db, phase_deg: margins, inf without a crossing. crossover: highest frequency [rad/s] at which the
    loop gain is 1; phase_crossover: lowest at which the phase is -180 deg; nan without one."""

    gain_db: float
    phase_deg: float
    crossover: float
    phase_crossover: float

    @property
    def enough(self) -> bool:
        """True for at least 6 dB and 45 deg."""
        return self.gain_db >= GAIN_MARGIN_DB and self.phase_deg >= PHASE_MARGIN_DEG


def frequencies(period: float, lowest: float = 0.05) -> Array:
    """Frequency grid [rad/s] for loops, up to the Nyquist frequency of a main loop of `period` [s]."""
    return np.geomspace(lowest, 0.999 * np.pi / period, POINTS)


def all_margins(loops: Complex, w: Array) -> tuple[Array, Array, Array, Array]:
    """(gain margin [dB], phase margin [deg], crossover, phase crossover [rad/s]), (n,) each, of (n, n_w)."""
    gain, phase_at = _gain_margins(loops, w)
    size = np.abs(loops)
    above = size > 1.0
    crossed = above[:, :-1] != above[:, 1:]
    margin, at = np.full(crossed.shape, np.inf), np.full(crossed.shape, -np.inf)
    row, k = np.nonzero(crossed)  # few; the powers and angles of all would take most of the time
    log, next_log = np.log(size[row, k]), np.log(size[row, k + 1])
    share = -log / (next_log - log)
    margin[row, k] = np.degrees(np.angle(-(loops[row, k] + share * (loops[row, k + 1] - loops[row, k]))))
    at[row, k] = w[k] * (w[k + 1] / w[k]) ** share
    last = np.where(crossed.any(axis=1), np.fmax.reduce(at, axis=1), np.nan)
    return gain, margin.min(axis=1), last, phase_at


def _gain_margins(loops: Complex, w: Array) -> tuple[Array, Array]:
    """Gain margins [dB] at crossings of the negative real axis, and the lowest such frequency [rad/s]."""
    re, im = loops.real, loops.imag
    crossed = (im[:, :-1] * im[:, 1:] < 0) & (np.minimum(re[:, :-1], re[:, 1:]) < 0)
    sizes, frequency = np.zeros(crossed.shape), np.full(crossed.shape, np.inf)
    row, k = np.nonzero(crossed)
    share = im[row, k] / (im[row, k] - im[row, k + 1])
    real = re[row, k] + share * (re[row, k + 1] - re[row, k])
    sizes[row, k] = np.where(real < 0, -real, 0.0)
    frequency[row, k] = np.where(real < 0, w[k] * (w[k + 1] / w[k]) ** share, np.inf)
    size, at = sizes.max(axis=1), frequency.min(axis=1)
    db = np.where(size > 0, -20 * np.log10(np.maximum(size, 1e-12)), np.inf)
    return db, np.where(np.isfinite(at), at, np.nan)


def margins(loop: Complex, w: Array) -> Margins:
    """The margins of one loop (n_w,) at w (n_w,) rad/s."""
    return Margins(*(float(found[0]) for found in all_margins(loop[None, :], w)))


def bandwidth(closed: Complex, w: Array) -> float:
    """The frequency [rad/s] at which |r / target| (n_w,) is first 3 dB below its value at the lowest one."""
    db = 20 * np.log10(np.abs(closed) / abs(closed[0]))
    below = np.flatnonzero(db < -3.0)
    if below.size == 0:
        return float(w[-1])
    k = int(below[0])
    share = (-3.0 - db[k - 1]) / (db[k] - db[k - 1])
    return float(w[k - 1] * (w[k] / w[k - 1]) ** share)
