"""Windowed spectra of signals on their own time stamps (method of Tischler & Remple 2012, ch. 7).

Each signal is transformed where it was sampled: samples by the discrete-time Fourier sum with
trapezoidal weights, a staircase (PWM) by the integral of its steps. Nothing is interpolated, so a
10 Hz log loses neither gain nor phase below its Nyquist frequency.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array, Signal
from rover_sweep.spectra.averages import independent_averages
from rover_sweep.spectra.band_limited import between, even_grid
from rover_sweep.spectra.exponentials import Complex, EvenExponentials, Exponentials

OVERLAP = 0.8
PER_PERIOD = 24  # samples a period of w_max that even samples are averaged down to
EVEN = 0.05  # sd of the sampling step over the step, up to which samples count as even
MANY = 500  # frequencies, from which on spectra are taken on even grids and interpolated
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


def cell_means(signal: Signal, w: Array, w_max: float) -> tuple[Signal, Array]:
    """The signal as means over cells short against 2 pi/w_max, and their gain (n_w,) at w [rad/s].

    A staircase is averaged exactly (gain sinc); even samples far faster than w_max n at a time (gain
    sin(n w T/2)/(n sin(w T/2))), which saves the time of transforming each; others stay as they are.
    """
    if not signal.hold:
        return _thinned(signal, w, w_max)
    step = 2 * np.pi / w_max / 16
    n = int(np.ceil((signal.t[-1] - signal.t[0]) / step))
    grid = signal.t[0] + (np.arange(n) + 0.5) * step
    return replace(signal, t=grid, x=signal.on(grid), hold=False), np.sinc(w * step / (2 * np.pi))


def _thinned(signal: Signal, w: Array, w_max: float) -> tuple[Signal, Array]:
    steps = np.diff(signal.t)
    step = float(np.median(steps))
    n = int(2 * np.pi / w_max / PER_PERIOD / step)
    if n < 2 or np.std(steps) > EVEN * step:
        return signal, np.ones(w.size)
    whole = signal.t.size // n * n
    t, x = (a[:whole].reshape(-1, n).mean(axis=1) for a in (signal.t, signal.x))
    return replace(signal, t=t, x=x), np.sin(n * w * step / 2) / (n * np.sin(w * step / 2))


class Transformer:
    """Fourier transforms at w [rad/s] of every window of every length over start..end [s].

    Signals on the same time stamps share the exponentials, which cost most of the time. even: w is
    evenly spaced, which is faster. w_max: highest frequency that is asked for in the end, w[-1] if none.
    """

    def __init__(
        self,
        start: float,
        end: float,
        lengths: Sequence[float],
        w: Array,
        even: bool = False,
        w_max: float | None = None,
    ) -> None:
        self.w, self.even, self.w_max = w, even, w_max or float(w[-1])
        self.windows = [(window_starts(start, end, length), length) for length in lengths]
        self._kernels: list[tuple[Array, Exponentials | EvenExponentials]] = []

    def __call__(self, signal: Signal) -> list[Complex]:
        """A list, per length, of (n_windows, n_w) arrays."""
        points, cell = cell_means(signal, self.w, self.w_max)
        points = detrended(points)
        weighted = replace(points, x=points.x * _durations(points))
        return [self._windowed(weighted, starts, length) / cell for starts, length in self.windows]

    def _windowed(self, weighted: Signal, starts: Array, length: float) -> Complex:
        t, kernel = weighted.t, self._kernel(weighted.t)
        rows = np.empty((starts.size, self.w.size), dtype=complex)
        for i, s in enumerate(starts):
            lo, hi = np.searchsorted(t, (s, s + length))
            rows[i] = kernel.sum(lo, hi, hann((t[lo:hi] - s) / length) * weighted.x[lo:hi])
        return rows

    def _kernel(self, t: Array) -> Exponentials | EvenExponentials:
        for known, kernel in self._kernels:
            if known.size == t.size and np.array_equal(known, t):
                return kernel
        made = EvenExponentials(t, self.w) if self.even else Exponentials(t, self.w)
        self._kernels.append((t, made))
        return made


def _transformers(
    span: tuple[float, float], lengths: Sequence[float], w: Array
) -> list[tuple[Transformer, list[int]]]:
    """Transformers, and which of the lengths each is for: one for all at few frequencies.

    At many, each length has its own even grid, no finer than its windows tell frequencies apart.
    """
    if w.size < MANY:
        return [(Transformer(*span, lengths, w), list(range(len(lengths))))]
    top = float(w[-1])
    return [
        (Transformer(*span, [length], even_grid(w, length), True, top), [i])
        for i, length in enumerate(lengths)
    ]


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
    sums = {output: [_Sums() for _ in lengths] for output in outputs}
    for channels, span in zip(runs, spans, strict=True):
        for transform, which in _transformers(span, lengths, w):
            x = transform(channels[input])
            for output in outputs:
                y = transform(channels[output])
                for i, xs, ys in zip(which, x, y, strict=True):
                    sums[output][i].add(transform.w, xs, ys)
    return {
        output: tuple(
            part.averaged(w, length, effective_averages(spans, length))
            for part, length in zip(parts, lengths, strict=True)
            if part.count
        )
        for output, parts in sums.items()
    }


class _Sums:
    """Running sums |X|^2, |Y|^2, conj(X) Y of one window length, at w or on an even grid around it."""

    def __init__(self) -> None:
        self.count, self.grid, self.total = 0, np.empty(0), np.zeros((3, 1), dtype=complex)

    def add(self, grid: Array, x: Complex, y: Complex) -> None:
        new = np.array([np.sum(a.conj() * b, axis=0) for a, b in ((x, x), (y, y), (x, y))])
        self.grid, self.total = grid, self.total + new
        self.count += len(x)

    def averaged(self, w: Array, length: float, averages: float) -> WindowSpectra:
        scale = 2.0 / length / self.count * np.where(w >= 2 * np.pi / length * (1 - 1e-9), 1.0, np.nan)
        total = self.total if self.grid is w else between(self.grid, self.total, w)
        xx, yy, xy = total
        return WindowSpectra(length, w, scale * xx.real, scale * yy.real, np.asarray(scale * xy), averages)
