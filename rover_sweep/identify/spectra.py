"""Windowed spectra of signals on their own time stamps (method of Tischler & Remple 2012, ch. 7).

Each signal is transformed where it was sampled: samples by the discrete-time Fourier sum with
trapezoidal weights, a staircase (PWM) by the integral of its steps. Nothing is interpolated, so a
10 Hz log loses neither gain nor phase below its Nyquist frequency.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rover_sweep.identify.averages import independent_averages
from rover_sweep.identify.recording import Array, Signal

Complex = NDArray[np.complex128]
OVERLAP = 0.8
OVERLAP_CONSTANT = 0.50**0.5  # C of the random error at 80 % overlap (Tischler & Remple 2012)


@dataclass(frozen=True, eq=False)
class WindowSpectra:
    """Averaged spectra of one window length over all runs; arrays (n_w,), nan below 2 pi/length.

    gxx, gyy in unit^2 s, gxy = conj(X) Y, all with 2/T_win (equation 6 of the paper, its T read as
    T_win). averages: n_d as `effective_averages` counts it, T_F/T_win where that is large.
    """

    length: float
    w: Array
    gxx: Array
    gyy: Array
    gxy: Complex
    averages: float

    @property
    def coherence(self) -> Array:
        """Ordinary coherence, equation (8)."""
        return np.abs(self.gxy) ** 2 / (self.gxx * self.gyy)

    @property
    def random_error(self) -> Array:
        """Normalised random error of |H|: C sqrt(1 - g2) / (|g| sqrt(2 n_d))."""
        g2 = np.clip(self.coherence, 1e-9, 1.0 - 1e-9)
        return OVERLAP_CONSTANT * np.sqrt(1.0 - g2) / np.sqrt(2.0 * self.averages * g2)


def hann(fraction: Array) -> Array:
    """Hann window at fractions 0..1 of its length, zero outside."""
    inside = (fraction >= 0) & (fraction <= 1)
    return inside * (0.5 - 0.5 * np.cos(2 * np.pi * fraction))


def detrended(signal: Signal) -> Signal:
    """The signal less its least-squares line, weighted by the time each sample stands for."""
    weight = np.sqrt(_durations(signal))
    centred = signal.t - signal.t.mean()
    basis = np.column_stack((np.ones_like(centred), centred))
    line = np.linalg.lstsq(basis * weight[:, None], signal.x * weight, rcond=None)[0]
    return replace(signal, x=signal.x - basis @ line)


def _durations(signal: Signal) -> Array:
    """The time [s] that each sample stands for: trapezoidal, or until the next step of a staircase."""
    steps = np.diff(signal.t)
    if signal.hold:
        return np.append(steps, np.median(steps))
    return np.concatenate(([steps[0]], steps[:-1] + steps[1:], [steps[-1]])) / 2


def window_starts(start: float, end: float, length: float) -> Array:
    """Starts of windows of `length` that cover start..end evenly with at least 80 % overlap."""
    room = end - start - length
    if room < -1e-9:
        return np.empty(0)
    count = int(np.ceil(max(room, 0.0) / ((1 - OVERLAP) * length) - 1e-9)) + 1
    return start + np.linspace(0.0, max(room, 0.0), count)


def effective_averages(spans: Sequence[tuple[float, float]], length: float) -> float:
    """n_d of windows of `length` over runs with these spans [s], such that the random error's formula holds.

    T_F/T_win where that is large; less near the length of the runs (15 s in 20 s: .72 in place of 1.33),
    where the plain ratio made the error of the estimates half of what it is (measured on white noise).
    """
    starts = [window_starts(start, end, length) for start, end in spans]
    return OVERLAP_CONSTANT**2 * independent_averages(starts, length)


def sampled_evenly(signal: Signal, w_max: float) -> tuple[Signal, float]:
    """A staircase as cell means on a grid fine enough for w_max [rad/s], and its step [s] (0 for samples).

    The mean over a cell multiplies the transform by sinc(w step/2 pi), which `Transformer` takes out.
    """
    if not signal.hold:
        return signal, 0.0
    step = 2 * np.pi / w_max / 16
    n = int(np.ceil((signal.t[-1] - signal.t[0]) / step))
    grid = signal.t[0] + (np.arange(n) + 0.5) * step
    return replace(signal, t=grid, x=signal.on(grid), hold=False), step


class Transformer:
    """Fourier transforms at w [rad/s] of every window of every length over start..end [s].

    Signals on the same time stamps share the exponentials, which cost most of the time.
    """

    def __init__(self, start: float, end: float, lengths: Sequence[float], w: Array) -> None:
        self.w = w
        self.windows = [(window_starts(start, end, length), length) for length in lengths]
        self._kernels: list[tuple[Array, Complex]] = []

    def __call__(self, signal: Signal) -> list[Complex]:
        """A list, per length, of (n_windows, n_w) arrays."""
        points, step = sampled_evenly(signal, float(self.w[-1]))
        points = detrended(points)
        scaled = self._kernel(points.t) * (points.x * _durations(points))[:, None]
        if step:
            scaled /= np.sinc(self.w * step / (2 * np.pi))
        return [self._windowed(points.t, scaled, starts, length) for starts, length in self.windows]

    def _windowed(self, t: Array, scaled: Complex, starts: Array, length: float) -> Complex:
        rows = np.empty((starts.size, self.w.size), dtype=complex)
        for i, s in enumerate(starts):
            lo, hi = np.searchsorted(t, (s, s + length))
            rows[i] = hann((t[lo:hi] - s) / length) @ scaled[lo:hi]
        return rows

    def _kernel(self, t: Array) -> Complex:
        for known, kernel in self._kernels:
            if known.size == t.size and np.array_equal(known, t):
                return kernel
        angle = np.outer(t, self.w)
        kernel = np.cos(angle) - 1j * np.sin(angle)
        self._kernels.append((t, kernel))
        return kernel


def window_spectra(
    runs: Sequence[Mapping[str, Signal]],
    spans: Sequence[tuple[float, float]],
    outputs: Sequence[str],
    lengths: Sequence[float],
    w: Array,
    input: str = "delta",
) -> dict[str, tuple[WindowSpectra, ...]]:
    """Averaged spectra input -> each output for each window length [s] at w [rad/s], over all runs.

    runs: channels within the spans. No window crosses from one run into another. Lengths that fit
    in no run are left out. ValueError where the longest does not resolve the lowest w.
    """
    longest = max((n for n in lengths if any(e - s >= n for s, e in spans)), default=0.0)
    if not longest or w[0] < 2 * np.pi / longest * (1 - 1e-9):
        raise ValueError(f"the longest usable window, {longest:g} s, resolves nothing at {w[0]:g} rad/s")
    sums = {output: [_Sums(w) for _ in lengths] for output in outputs}
    for channels, span in zip(runs, spans, strict=True):
        transform = Transformer(*span, lengths, w)
        x = transform(channels[input])
        for output in outputs:
            for acc, xs, ys in zip(sums[output], x, transform(channels[output]), strict=True):
                acc.add(xs, ys)
    return {
        output: tuple(
            a.averaged(length, effective_averages(spans, length))
            for a, length in zip(parts, lengths, strict=True)
            if a.count
        )
        for output, parts in sums.items()
    }


class _Sums:
    """Running sums of the spectra of one window length."""

    def __init__(self, w: Array) -> None:
        self.w, self.count = w, 0
        self.xx, self.yy, self.xy = np.zeros(w.size), np.zeros(w.size), np.zeros(w.size, dtype=complex)

    def add(self, x: Complex, y: Complex) -> None:
        self.count += len(x)
        self.xx += np.sum(np.abs(x) ** 2, axis=0)
        self.yy += np.sum(np.abs(y) ** 2, axis=0)
        self.xy += np.sum(np.conj(x) * y, axis=0)

    def averaged(self, length: float, averages: float) -> WindowSpectra:
        scale = 2.0 / length / self.count * np.where(self.w >= 2 * np.pi / length * (1 - 1e-9), 1.0, np.nan)
        xy = (scale * self.xy).astype(complex)
        return WindowSpectra(length, self.w, scale * self.xx, scale * self.yy, xy, averages)
