"""The noise floor of a recording, found where the excitation is not.

A sweep excites one frequency at a time. Whatever stands in the residual of a fit away from that
frequency and its multiples is noise: power over frequency, per channel, pooled over runs. Gyy (1 - g2)
would contain the distortion that is looked for.
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
BESIDE = 0.6  # Hz, either side of a line that a Hann window of 4 s and a moving sweep can reach
RESOLVED = 1.0  # Hz, from which taking a line out of a frame costs no power
ENOUGH = 100  # lines of quiet frames
EXCITED = 0.04  # of the largest steering amplitude


@dataclass(frozen=True, eq=False)
class Floor:
    """One-sided noise density per channel: f (k,) Hz, density {channel: (k,)} unit^2/Hz."""

    f: Array
    density: Mapping[str, Array]

    def at(self, channel: str, f: Array) -> Array:
        """Density at f [Hz], log-linear between the estimates, flat above them.

        Below the lowest one, that a window can resolve, it may grow as 1/f^2: camber, gusts and drift do.
        """
        inside = np.exp(np.interp(f, self.f, np.log(self.density[channel])))
        lowest = self.f[0]
        return np.where(f < lowest, inside * (lowest / np.maximum(f, 0.05 * lowest)) ** 2, inside)

    def rms(self, channel: str, low: float, high: float) -> float:
        """RMS of the noise between two frequencies [Hz]."""
        f = np.linspace(low, high, 60)
        return float(np.sqrt(np.trapezoid(self.at(channel, f), f)))


def floor_of(runs: Sequence[Experiment], residuals: Sequence[Mapping[str, Array]]) -> Floor:
    """The floor of runs whose residuals {channel: (n,)} are given, pooled over the runs."""
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
    """(f (k,) Hz, number (k,) of frames over all runs from which a floor at that frequency is known)."""
    size = int(WINDOW * RATE)
    f: Array = np.asarray(np.fft.rfftfreq(size, 1 / RATE), np.float64)
    count = np.sum([np.sum(_quiet(run, f, size), axis=0) for run in runs], axis=0)
    return f[1:], np.asarray(count[1:], np.float64)


def level_of(run: Experiment, residual: Mapping[str, Array], floor: Floor) -> dict[str, float]:
    """{channel: power of one run's noise over that of a floor}; residual {channel: (n,)} of the right model.

    Over all quiet frames of all frequencies that the lines of a frame resolve; 1 where they are few.
    """
    size = int(WINDOW * RATE)
    f: Array = np.asarray(np.fft.rfftfreq(size, 1 / RATE), np.float64)
    out = {}
    for channel, x in residual.items():
        seen = _quiet(run, f, size) & (f >= RESOLVED) & (f <= 0.4 * run.rates.get(channel, RATE))
        ratio = _power(x, size)[:, 1:] / floor.at(channel, f[1:])
        out[channel] = float(np.mean(ratio[seen[:, 1:]])) if seen.sum() >= ENOUGH else 1.0
    return out


def _frames(x: Array, size: int) -> Array:
    """Overlapping frames (m, size) of x, a second apart."""
    starts = np.arange(0, max(x.size - size, 0) + 1, int(RATE))
    return np.stack([x[s : s + size] for s in starts]) if x.size >= size else np.zeros((0, size))


def _power(x: Array, size: int) -> Array:
    frames = _frames(x, size)
    k = np.arange(size) - 0.5 * (size - 1)
    slope = (frames @ k) / (k @ k)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(size) + 0.5) / size)
    flat = frames - frames.mean(axis=1, keepdims=True) - slope[:, None] * k
    power = np.abs(np.fft.rfft(flat * window, axis=1)) ** 2 * (2 / (RATE * np.sum(window**2)))
    return np.asarray(power / _kept(size))


@cache
def _kept(size: int) -> Array:
    """Share (k,) of white noise that a line keeps when mean and slope are taken out of its frame."""
    k = np.arange(size) - 0.5 * (size - 1)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(size) + 0.5) / size)
    taken = [np.abs(np.fft.rfft(window * u / np.linalg.norm(u))) ** 2 for u in (np.ones(size), k)]
    kept = np.maximum(1.0 - (taken[0] + taken[1]) / np.sum(window**2), 0.05)
    return np.asarray(kept, np.float64)


def _quiet(run: Experiment, f: Array, size: int) -> NDArray[np.bool_]:
    """(m, k) True where the run excites neither that frequency nor one of which it is a multiple."""
    frames = _frames(run.steer, size)
    flat = frames - frames.mean(axis=1, keepdims=True)
    window = np.hanning(size)
    lines = np.abs(np.fft.rfft(flat * window, axis=1)) / (0.25 * size)
    loud = lines > EXCITED * run.amplitude
    reach = int(np.ceil(BESIDE / f[1]))
    quiet = np.ones_like(loud)
    for row in range(loud.shape[0]):
        for k in np.flatnonzero(loud[row]):
            for multiple in range(HARMONICS + 1):
                quiet[row, max(multiple * k - reach, 0) : multiple * k + reach + 1] = False
    return quiet


def _pooled(power: Array, f: Array) -> Array:
    """Mean power per frequency where at least four frames were quiet; the rest from the neighbours."""
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
