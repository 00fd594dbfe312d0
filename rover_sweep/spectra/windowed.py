"""Windowed spectra of signals on their own time stamps (Tischler & Remple 2012, chapter 7).

Each signal is transformed at its own time stamps: samples by a Fourier sum with trapezoidal weights, a
staircase (PWM) by the integral of its steps. Without interpolation, a 10 Hz log loses neither gain nor phase
below its Nyquist frequency.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array, Signal
from rover_sweep.spectra.averages import independent_averages
from rover_sweep.spectra.band_limited import even_grid, sinc_interpolated
from rover_sweep.spectra.exponentials import Complex, EvenExponentials, Exponentials

OVERLAP = 0.8  # of neighbouring windows
PER_PERIOD = 24  # samples per period of w_max; faster even samples are averaged
EVEN = 0.05  # largest sd of the sampling step over the step, of even samples
MANY = 500  # frequencies; from this number on, spectra are computed on even grids and interpolated
OVERLAP_CONSTANT = 0.50**0.5  # C of the random error at 80 % overlap (Tischler & Remple 2012)


@dataclass(frozen=True, eq=False)
class WindowSpectra:
    """Averaged spectra of one window length over all runs; arrays (n_w,), nan below 2 pi/length.

    gxx, gyy [unit^2 s], gxy = conj(X) Y, all times 2/T_win (equation 6 of the paper, its T read as T_win);
    length: T_win [s], w [rad/s]. averages: n_d of `effective_averages`, T_F/T_win for long records.
    """

    length: float
    w: Array
    gxx: Array
    gyy: Array
    gxy: Complex
    averages: float

    @property
    def coherence(self) -> Array:
        """|Gxy|^2/(Gxx Gyy) (n_w,), equation (8)."""
        return np.abs(self.gxy) ** 2 / (self.gxx * self.gyy)

    @property
    def random_error(self) -> Array:
        """Normalised random error of |H| (n_w,): C sqrt(1 - g2) / (|g| sqrt(2 n_d)) (T&R 2012, ch. 7)."""
        g2 = np.clip(self.coherence, 1e-9, 1.0 - 1e-9)
        return OVERLAP_CONSTANT * np.sqrt(1.0 - g2) / np.sqrt(2.0 * self.averages * g2)


def hann(fraction: Array) -> Array:
    """Hann window at fractions 0..1 of its length, zero outside."""
    inside = (fraction >= 0) & (fraction <= 1)
    return inside * (0.5 - 0.5 * np.cos(2 * np.pi * fraction))


def detrended(signal: Signal) -> Signal:
    """The signal minus its least-squares line, samples weighted by their durations."""
    weight = np.sqrt(_durations(signal))
    centred = signal.t - signal.t.mean()
    basis = np.column_stack((np.ones_like(centred), centred))
    line = np.linalg.lstsq(basis * weight[:, None], signal.x * weight, rcond=None)[0]
    return replace(signal, x=signal.x - basis @ line)


def _durations(signal: Signal) -> Array:
    """Duration (n,) [s] of each sample: trapezoidal, or until the next step of a staircase."""
    steps = np.diff(signal.t)
    if signal.hold:
        return np.append(steps, np.median(steps))
    return np.concatenate(([steps[0]], steps[:-1] + steps[1:], [steps[-1]])) / 2


def window_starts(start: float, end: float, length: float) -> Array:
    """Starts (n_windows,) [s] of windows of `length` [s], evenly over start..end with >= 80 % overlap."""
    room = end - start - length
    if room < -1e-9:
        return np.empty(0)
    count = int(np.ceil(max(room, 0.0) / ((1 - OVERLAP) * length) - 1e-9)) + 1
    return start + np.linspace(0.0, max(room, 0.0), count)


def effective_averages(spans: Sequence[tuple[float, float]], length: float) -> float:
    """n_d of the random error's formula, for windows of `length` [s] over runs with spans (start, end) [s].

    T_F/T_win for long runs, less near the length of the runs (15 s in 20 s: .72 instead of 1.33). There
    T_F/T_win would give half the true random error (checked on white noise).
    """
    starts = [window_starts(start, end, length) for start, end in spans]
    return OVERLAP_CONSTANT**2 * independent_averages(starts, length)


def cell_means(signal: Signal, w: Array, w_max: float) -> tuple[Signal, Array]:
    """The signal averaged over cells much shorter than 2 pi/w_max, and the gain (n_w,) of this at w [rad/s].

    A staircase is averaged exactly (gain: sinc). Even samples much faster than w_max are averaged in groups
    of n (gain: sin(n w T/2)/(n sin(w T/2))) to save time; other samples stay as they are.
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

    Signals on the same time stamps share the exponentials, which take most of the time. w (n_w,); even: w is
    evenly spaced, which is faster. w_max [rad/s]: highest frequency of interest, default w[-1].
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
        """Transforms (n_windows, n_w), unit s, for each length."""
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
    """[(transformer, indices of its lengths)]: one transformer for all lengths at few frequencies.

    For many frequencies, one for each length on its own even grid, as fine as its windows resolve.
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

    runs: {channel: signal}, with spans (start, end) [s]. Each window lies within one run. Lengths that fit
    into no run are left out. ValueError when the longest does not resolve the lowest w.
    """
    longest = max((n for n in lengths if any(e - s >= n for s, e in spans)), default=0.0)
    if not longest or w[0] < 2 * np.pi / longest * (1 - 1e-9):
        raise ValueError(
            f"the longest usable window, {longest:g} s, is too short for {w[0]:g} rad/s: drive longer runs "
            "or raise the lowest frequency"
        )
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
    """Sums of |X|^2, |Y|^2, conj(X) Y over the windows of one length, at w or on an even grid."""

    def __init__(self) -> None:
        self.count, self.grid, self.total = 0, np.empty(0), np.zeros((3, 1), dtype=complex)

    def add(self, grid: Array, x: Complex, y: Complex) -> None:
        new = np.array([np.sum(a.conj() * b, axis=0) for a, b in ((x, x), (y, y), (x, y))])
        self.grid, self.total = grid, self.total + new
        self.count += len(x)

    def averaged(self, w: Array, length: float, averages: float) -> WindowSpectra:
        scale = 2.0 / length / self.count * np.where(w >= 2 * np.pi / length * (1 - 1e-9), 1.0, np.nan)
        total = self.total if self.grid is w else sinc_interpolated(self.grid, self.total, w)
        xx, yy, xy = total
        return WindowSpectra(length, w, scale * xx.real, scale * yy.real, np.asarray(scale * xy), averages)
