"""The noise floor of a recording, measured at the frequencies that the steering does not excite.

A sweep excites one frequency at a time, so at all others, but its multiples, the residual is noise. The
estimate Gyy (1 - coherence) would contain the distortion that the diagnosis looks for.

1. The residual is cut into frames of `WINDOW`, one second apart. Mean and slope are taken out and a Hann
   window w is applied (Welch 1967). One-sided density of a line X_k: 2 |X_k|^2 / (rate sum w^2).
2. Taking out mean and slope, the orthonormal vectors u_1, u_2, also takes noise. Of white noise the line k
   keeps the share 1 - sum_i |FFT(w u_i)_k|^2 / sum w^2, by which the density is divided (exact, since the
   removal is a projection).
3. A line counts as excited where the steering's amplitude there is above `EXCITED` of its largest. It, its
   multiples up to `HARMONICS`, the mean, and `GUARD` Hz on either side are left out.
4. The density at a frequency is the mean of the remaining frames of all runs, at least four; where fewer
   remain it is interpolated in log density. Five lines with weights 1 2 3 2 1 smooth the result.

A mean over m independent frames has the relative standard deviation 1/sqrt(m) (Bendat and Piersol 2010,
chapter 8); `locate.residual_maps.floor_error` has the value measured for these overlapping frames.

Welch 1967: The use of fast Fourier transform for the estimation of power spectra, IEEE Trans. AU-15(2).
Bendat and Piersol 2010: Random Data, 4th edition, Wiley.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment

WINDOW = 4.0  # s
HARMONICS = 5
GUARD = 0.6  # Hz, reach of a line to either side: a Hann window of 4 s, and the sweep moves
RESOLVED = 1.0  # Hz, from which taking out mean and slope costs no power
ENOUGH = 100  # quiet lines from which the level of one run is estimated
EXCITED = 0.04  # of the largest steering amplitude


@dataclass(frozen=True, eq=False)
class Floor:
    """One-sided noise density per channel: f (k,) Hz, density {channel: (k,)} unit^2/Hz."""

    f: Array
    density: Mapping[str, Array]

    def at(self, channel: str, f: Array) -> Array:
        """Density (n,) at f (n,) [Hz], log-linear between the estimates, flat above them.

        Below the lowest frequency that a frame resolves it grows as 1/f^2, as camber, gusts and drift do.
        """
        inside = np.exp(np.interp(f, self.f, np.log(self.density[channel])))
        lowest = self.f[0]
        return np.where(f < lowest, inside * (lowest / np.maximum(f, 0.05 * lowest)) ** 2, inside)

    def rms(self, channel: str, low: float, high: float) -> float:
        """RMS of the noise between two frequencies [Hz], in the channel's SI unit."""
        f = np.linspace(low, high, 60)
        return float(np.sqrt(np.trapezoid(self.at(channel, f), f)))


def floor_of(runs: Sequence[Experiment], residuals: Sequence[Mapping[str, Array]]) -> Floor:
    """The floor pooled over runs, from the residuals {channel: (n,)} of each, in SI units."""
    size = int(WINDOW * RATE)
    f: Array = np.asarray(np.fft.rfftfreq(size, 1 / RATE), np.float64)
    channels = sorted({c for r in residuals for c in r})
    quiet = [_quiet(run, f, size) for run in runs]
    density = {}
    for channel in channels:
        powers = [
            np.where(mask, _power(found[channel], size), np.nan)
            for mask, found in zip(quiet, residuals, strict=True)
            if channel in found
        ]
        density[channel] = _pooled(np.concatenate(powers), f)
    return Floor(f[1:], density)


def quiet_frames(runs: Sequence[Experiment]) -> tuple[Array, Array]:
    """(f (k,) Hz, number (k,) of frames of all runs that are not excited at that frequency)."""
    size = int(WINDOW * RATE)
    f: Array = np.asarray(np.fft.rfftfreq(size, 1 / RATE), np.float64)
    count = np.sum([np.sum(_quiet(run, f, size), axis=0) for run in runs], axis=0)
    return f[1:], np.asarray(count[1:], np.float64)


def level_of(run: Experiment, residual: Mapping[str, Array], floor: Floor) -> dict[str, float]:
    """{channel: noise power of one run over that of a floor}.

    residual {channel: (n,)}: of a model that fits. Mean over all quiet lines that a frame resolves; 1 where
    they are fewer than `ENOUGH`.
    """
    size = int(WINDOW * RATE)
    f: Array = np.asarray(np.fft.rfftfreq(size, 1 / RATE), np.float64)
    out = {}
    for channel, x in residual.items():
        quiet = _quiet(run, f, size) & (f >= RESOLVED) & (f <= 0.4 * run.rates.get(channel, RATE))
        ratio = _power(x, size)[:, 1:] / floor.at(channel, f[1:])
        out[channel] = float(np.mean(ratio[quiet[:, 1:]])) if quiet.sum() >= ENOUGH else 1.0
    return out


def _frames(x: Array, size: int) -> Array:
    """Overlapping frames (m, size) of x, a second apart."""
    starts = np.arange(0, max(x.size - size, 0) + 1, int(RATE))
    return np.stack([x[s : s + size] for s in starts]) if x.size >= size else np.zeros((0, size))


def _power(x: Array, size: int) -> Array:
    """One-sided density (m, k) of each frame, unit^2/Hz."""
    frames = _frames(x, size)
    k = np.arange(size) - 0.5 * (size - 1)
    slope = (frames @ k) / (k @ k)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(size) + 0.5) / size)
    flat = frames - frames.mean(axis=1, keepdims=True) - slope[:, None] * k
    power = np.abs(np.fft.rfft(flat * window, axis=1)) ** 2 * (2 / (RATE * np.sum(window**2)))
    return np.asarray(power / _retained(size))


@cache
def _retained(size: int) -> Array:
    """Share (k,) of white noise that a line keeps when mean and slope are removed from its frame."""
    k = np.arange(size) - 0.5 * (size - 1)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(size) + 0.5) / size)
    taken = [np.abs(np.fft.rfft(window * u / np.linalg.norm(u))) ** 2 for u in (np.ones(size), k)]
    retained = np.maximum(1.0 - (taken[0] + taken[1]) / np.sum(window**2), 0.05)
    return np.asarray(retained, np.float64)


def _quiet(run: Experiment, f: Array, size: int) -> NDArray[np.bool_]:
    """(m, k) True where the run excites neither that frequency nor one of its subharmonics."""
    frames = _frames(run.steer, size)
    flat = frames - frames.mean(axis=1, keepdims=True)
    window = np.hanning(size)
    lines = np.abs(np.fft.rfft(flat * window, axis=1)) / (0.25 * size)
    excited = lines > EXCITED * run.amplitude
    reach = int(np.ceil(GUARD / f[1]))
    quiet = np.ones_like(excited)
    for row in range(excited.shape[0]):
        for k in np.flatnonzero(excited[row]):
            for multiple in range(HARMONICS + 1):
                quiet[row, max(multiple * k - reach, 0) : multiple * k + reach + 1] = False
    return quiet


def _pooled(power: Array, f: Array) -> Array:
    """Mean density (k-1,) of the quiet frames where there are at least four, else from the neighbours."""
    count = np.sum(~np.isnan(power), axis=0)
    with np.errstate(invalid="ignore"):
        mean = np.where(count >= 4, np.nansum(power, axis=0) / np.maximum(count, 1), np.nan)
    known = np.flatnonzero(~np.isnan(mean[1:])) + 1
    if known.size < 3:
        mean = np.nanmin(np.where(np.isnan(power), np.inf, power), axis=0)
        known = np.flatnonzero(np.isfinite(mean[1:])) + 1
    logs = np.interp(np.arange(1, f.size), known, np.log(np.maximum(mean[known], 1e-30)))
    kernel = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0
    return np.exp(np.convolve(np.pad(logs, 2, mode="edge"), kernel, mode="valid"))
