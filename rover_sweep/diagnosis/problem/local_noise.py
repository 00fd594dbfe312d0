"""The noise floor of a table: runs by hand, smoothed or resampled, whose sensors' low-passes are not known.

Driving by hand excites every low frequency in every frame, so no line is quiet, and the few quiet lines lie
where smoothing took the noise away. There the floor would be near zero, and everything significant. So:

1. Where a line is never quiet, the noise is what neighbouring lines do not share: over 2 n + 1 lines of a
   run, a smooth response to the steering and a smooth transient are fitted to the residual (local polynomial
   method, Pintelon and Schoukens 2012, chapter 7), or the frames of all runs share one response. What is left
   is noise and what a nonlinear law scatters; both estimates are rather too large, so the smaller one counts.
2. Above `BAND` the floor is at least `KEPT` of its median within that band: smoothing takes the noise away,
   but a model does not become more accurate there.
3. The signal resolves nothing above the frequency at which its own density falls below `COLLAPSED` of that
   median. Lines beyond are not used.

Pintelon and Schoukens 2012: System Identification, a frequency domain approach, 2nd edition, Wiley.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment

Lines = NDArray[np.complex128]
BAND = (1.0, 4.0)  # Hz, above most driving and below any smoothing
KEPT = 0.25
COLLAPSED = 0.1
LOWEST_TOP = 2.0  # Hz, so that a yaw mode stays visible
TOP = 14.0  # Hz, a little above the highest line in use
FEWEST = 5.0  # frames from which a common response leaves enough
LONG = 10.0  # s, from which a run has lines enough for a quadratic


@dataclass(frozen=True)
class Neighbours:
    """Lines on each side of one, and the degree of the polynomials in frequency."""

    reach: int
    degree: int

    @property
    def freedom(self) -> int:
        """Complex degrees of freedom that two polynomials leave."""
        return 2 * self.reach + 1 - 2 * (self.degree + 1)


def is_table(runs: Sequence[Experiment]) -> bool:
    """True for runs without any known low-pass: not of an autopilot, and perhaps smoothed."""
    return not any(run.filters for run in runs)


def local_density(run: Experiment, residual: Array) -> tuple[Array, Array]:
    """(f (k,) Hz, one-sided density (k,) unit^2/Hz) of what near lines of a residual (n,) do not share."""
    kind = Neighbours(6, 2) if run.t.size > LONG * RATE else Neighbours(4, 1)
    lines = int(min(TOP * run.t.size / RATE, run.t.size // 2))
    drive, out = (np.fft.rfft(x)[1 : lines + 1] for x in (run.steer * run.speed, residual))
    centres = np.arange(kind.reach, lines - kind.reach, max(kind.reach // 2, 1))
    if centres.size == 0:
        return np.empty(0), np.empty(0)
    near = np.arange(-kind.reach, kind.reach + 1)
    powers = (near / kind.reach)[:, None] ** np.arange(kind.degree + 1)[None, :]
    u, y = drive[centres[:, None] + near], out[centres[:, None] + near]
    scale = np.maximum(np.max(np.abs(u), axis=1, keepdims=True), 1e-30)
    transient = np.broadcast_to(powers + 0j, (*u.shape, powers.shape[1]))
    k = np.concatenate(((u / scale)[:, :, None] * powers, transient), axis=2)
    rest = y - np.einsum("mij,mj->mi", k, np.einsum("mji,mi->mj", np.linalg.pinv(k), y))
    power = np.sum(np.abs(rest) ** 2, axis=1) / kind.freedom
    return (centres + 1) * RATE / run.t.size, power * 2 / (RATE * run.t.size)


def pooled_local(runs: Sequence[Experiment], residuals: Sequence[Array], f: Array) -> Array:
    """The mean density (k,) of several runs at f (k,) [Hz]; NaN where no run has lines."""
    pairs = [local_density(run, x) for run, x in zip(runs, residuals, strict=True)]
    found = [(at, density) for at, density in pairs if at.size]
    if not found:
        return np.full(f.size, np.nan)
    parts = [np.interp(f, at, d) for at, d in found]
    weights = np.array([at.size for at, _ in found], float)
    return np.asarray(np.average(parts, axis=0, weights=weights))


def incoherent_density(drive: Lines, out: Lines, averages: float) -> Array:
    """Density (k,) of the lines `out` (m, k) that no common response to `drive` (m, k) gives, NaN for few.

    averages: independent frames, of the m that overlap.
    """
    if averages < FEWEST:
        return np.full(out.shape[1], np.nan)
    response = np.sum(np.conj(drive) * out, axis=0) / np.maximum(np.sum(np.abs(drive) ** 2, axis=0), 1e-30)
    rest = np.mean(np.abs(out - response * drive) ** 2, axis=0)
    return np.asarray(rest * averages / (averages - 1.0))


def bounded(f: Array, density: Array) -> Array:
    """The density (k,) at f (k,) [Hz], above `BAND` not below `KEPT` of its median there."""
    level = band_level(f, density)
    return np.where(f > BAND[1], np.maximum(density, KEPT * level), density)


def band_level(f: Array, density: Array) -> float:
    """Median density within `BAND`."""
    inside = (f >= BAND[0]) & (f <= BAND[1])
    return float(np.median(density[inside])) if inside.any() else 0.0


def resolved_top(f: Array, measured: Array, level: float) -> float:
    """The frequency [Hz] above which the measured density (k,) has collapsed; infinite where it has not.

    level: floor within `BAND`. Judged on the mean of an octave's third, so that a notch alone does not count.
    """
    width = max(int(np.ceil(1.0 / f[0])) if f[0] > 0 else 1, 1)  # lines within 1 Hz
    smooth = np.convolve(np.pad(measured, width // 2, mode="edge"), np.full(width, 1.0 / width), mode="same")
    smooth = smooth[width // 2 : width // 2 + f.size]
    low = np.flatnonzero((smooth < COLLAPSED * level) & (f >= LOWEST_TOP) & (f < TOP))
    return float(f[low[0]]) if low.size else float("inf")
