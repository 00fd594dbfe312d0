"""Windowed spectra of signals on their own time stamps (Tischler & Remple 2012, chapter 7).

Each signal is transformed at its own time stamps: samples by a Fourier sum with trapezoidal weights, a
staircase (PWM) by the integral of its steps. Without interpolation, a 10 Hz log loses neither gain nor phase
below its Nyquist frequency.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, Complex, Signal

# Fourier sums of samples at given frequencies, on any time stamps.


def _exponentials(t: Array, w: Array) -> Complex:
    angle = np.outer(t, w)
    kernel = np.empty(angle.shape, complex)
    np.cos(angle, out=kernel.real)
    np.negative(np.sin(angle, out=angle), out=kernel.imag)
    return kernel


class Exponentials:
    """exp(-j w t) for time stamps t (n,) [s] and frequencies w (n_w,) [rad/s]."""

    def __init__(self, t: Array, w: Array) -> None:
        self._kernel = _exponentials(t, w)

    def sum(self, first: int, last: int, weights: Array) -> Complex:
        """sum_k weights[k] exp(-j w t_k) (n_w,) over the time stamps first <= k < last."""
        total: Complex = weights @ self._kernel[first:last]
        return total


class EvenExponentials:
    """As `Exponentials`, for even frequencies w = w_0 + (a B + b) dw, faster.

    exp(-j w t) is the product of a coarse (a) and a fine (b) exponential, so each time stamp needs 2
    sqrt(n_w) exponentials instead of n_w, and the sums are a matrix product. Equal to the direct sums up to
    rounding.
    """

    def __init__(self, t: Array, w: Array) -> None:
        self._size = w.size
        columns = int(np.ceil(np.sqrt(w.size)))
        self._coarse = _exponentials(t, w[::columns])
        self._fine = _exponentials(t, w[:columns] - w[0])

    def sum(self, first: int, last: int, weights: Array) -> Complex:
        """sum_k weights[k] exp(-j w t_k) (n_w,) over the time stamps first <= k < last."""
        rows = (self._coarse[first:last] * weights[:, None]).T @ self._fine[first:last]
        return np.asarray(rows.ravel()[: self._size])


# The number of independent averages of overlapping windows, from their positions.
#
# T_F / T_win holds for records of many windows. Near the length of the record it is too large: three windows
# of 15 s within 20 s would count as 2.7 instead of 1.5. The longest window of a short record would then get
# too much weight in the composite, and its coherence by chance would count as signal.


def hann_correlation(shift: Array) -> Array:
    """Correlation (...) of a Hann window with itself at `shift` (...) of its length (Harris 1978, eq. 17)."""
    u = np.minimum(np.abs(shift), 1.0)
    return (1 - u) * (2 + np.cos(2 * np.pi * u)) / 3 + np.sin(2 * np.pi * u) / (2 * np.pi)


def independent_averages(starts: Sequence[Array], length: float) -> float:
    """Number of independent averages with the variance of the mean over overlapping windows (Welch 1967).

    n^2 / sum_ij rho^2((t_i - t_j)/length) for n windows of `length` [s] at t_i, rho the correlation of the
    window; tends to 1.9 T_F/T_win at 80 % overlap. starts: per run, (n_windows,) [s].
    """
    count = sum(s.size for s in starts)
    shared = sum(
        float(np.sum(hann_correlation((s[:, None] - s[None, :]) / length) ** 2)) for s in starts if s.size
    )
    return count**2 / shared if shared else 0.0


# Interpolation of spectra to any frequencies from an even grid as fine as the window resolves.
#
# The mean spectrum of windows of length T is the Fourier transform of a correlation that is zero beyond lags
# of +-T. By the sampling theorem its values on an even grid finer than pi/T determine it everywhere.


OVERSAMPLED = 2.0  # how much finer than pi/T the grid is
REACH = 12  # grid points on each side of an interpolated value; error 1e-8 of the largest of them


def even_grid(w: Array, length: float) -> Array:
    """Even grid (n_grid,) [rad/s] for interpolating spectra of windows of `length` [s] to w (ascending)."""
    step = np.pi / (OVERSAMPLED * length)
    count = int(np.ceil((w[-1] - w[0]) / step)) + 2 * REACH + 1
    return np.asarray(w[0] + step * (np.arange(count) - REACH))


def sinc_interpolated(grid: Array, values: NDArray[Any], w: Array) -> NDArray[Any]:
    """values (..., n_grid) on an even grid, interpolated to w (n_w,): (..., n_w).

    w must be within the range that `even_grid` was made for. A sinc times the window exp(b (sqrt(1 - u^2) -
    1)) (Barnett, Magland and af Klinteberg 2019).
    """
    place = (w - grid[0]) / (grid[1] - grid[0])
    nearest = np.clip(place.astype(int), REACH - 1, grid.size - REACH - 1)
    taps = np.arange(1 - REACH, REACH + 1)
    away = (place - nearest)[:, None] - taps
    sharpness = np.pi * REACH * (1 - 1 / OVERSAMPLED)
    inside = np.sqrt(np.maximum(1 - (away / REACH) ** 2, 0.0))
    weights = np.sinc(away) * np.exp(sharpness * (inside - 1))
    return np.asarray(np.einsum("...wk,wk->...w", values[..., nearest[:, None] + taps], weights))


OVERLAP = 0.8  # of neighbouring windows
PER_PERIOD = 24  # samples per period of w_max; faster even samples are averaged
EVEN = 0.05  # largest sd of the sampling step over the step, of even samples
KERNELS = 16  # kept: the channels of four runs, up to 15 MB each
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

    T_F/T_win for long runs, less for windows almost as long (15 s in 20 s: .72, not 1.33), for which
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

    def __call__(self, signal: Signal) -> list[Complex]:
        """Transforms (n_windows, n_w), unit s, for each length."""
        points, cell = cell_means(signal, self.w, self.w_max)
        points = detrended(points)
        weighted = replace(points, x=points.x * _durations(points))
        kernel = _kernel(weighted.t.tobytes(), self.w.tobytes(), self.even)
        return [self._windowed(weighted, kernel, starts, length) / cell for starts, length in self.windows]

    def _windowed(
        self, weighted: Signal, kernel: Exponentials | EvenExponentials, starts: Array, length: float
    ) -> Complex:
        t = weighted.t
        rows = np.empty((starts.size, self.w.size), dtype=complex)
        for i, s in enumerate(starts):
            lo, hi = np.searchsorted(t, (s, s + length))
            rows[i] = kernel.sum(lo, hi, hann((t[lo:hi] - s) / length) * weighted.x[lo:hi])
        return rows


@lru_cache(maxsize=KERNELS)
def _kernel(t: bytes, w: bytes, even: bool) -> Exponentials | EvenExponentials:
    """The exponentials of time stamps and frequencies, given as the bytes of their arrays."""
    stamps, frequencies = np.frombuffer(t), np.frombuffer(w)
    return EvenExponentials(stamps, frequencies) if even else Exponentials(stamps, frequencies)


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


ONE_AVERAGE = OVERLAP_CONSTANT**2  # of n_d for each independent average


# Spectra of correlated inputs. A throttle that moves with the steering and acts on the rover falsifies the
# simple response to the steering. At each frequency H = Gxx^-1 Gxy. Its element for one input equals the
# response between that input and the output after the part that follows the other inputs is removed from both
# (Bendat and Piersol 2010, chapter 7; Tischler and Remple 2012, chapter 9). The output's autospectrum is
# conditioned as well.


@dataclass(frozen=True, eq=False)
class InputSpectra:
    """Averaged spectra of one window length among several inputs and outputs, nan below 2 pi/length.

    gxx (n_w, nu, nu): conj(X_i) X_j; gxy {output: (n_w, nu)}: conj(X_i) Y; gyy {output: (n_w,)}; unit^2 s,
    scaled by 2/T_win; w (n_w,) [rad/s], length [s]. averages: n_d of `effective_averages`.
    """

    length: float
    w: Array
    inputs: tuple[str, ...]
    gxx: Complex
    gxy: Mapping[str, Complex]
    gyy: Mapping[str, Array]
    averages: float

    def responses(self, output: str) -> Complex:
        """H = Gxx^-1 Gxy (n_w, nu), the response of an output to each input, in their units."""
        h: Complex = np.einsum("wij,wj->wi", _inverse(self.gxx), self.gxy[output])
        return h

    def multiple_coherence(self, output: str) -> Array:
        """Share (n_w,) of the output's power that follows all inputs: Gyx Gxx^-1 Gxy / Gyy."""
        explained = np.einsum("wi,wi->w", self.gxy[output].conj(), self.responses(output)).real
        return np.asarray(explained / self.gyy[output])

    def input_coherence(self, input: str) -> Array:
        """Share (n_w,) of an input's power that follows the other inputs."""
        k, rest = self._split(input)
        x, g = self.gxx[:, rest, k], self.gxx[:, k, k].real
        return np.asarray(1 - _without(self.gxx, rest, x, x, g).real / g)

    def conditioned(self, input: str, output: str) -> WindowSpectra:
        """The spectra input -> output with the effect of the other inputs removed from both.

        Its coherence is the partial coherence |G1y.2|^2 / (G11.2 Gyy.2). Each other input takes one
        independent average, C^2 in n_d. On correlated white noise the random error is then right within 6 %;
        without it, up to 20 % too small.
        """
        k, rest = self._split(input)
        x, y = self.gxx[:, rest, k], self.gxy[output][:, rest]
        gxx = _without(self.gxx, rest, x, x, self.gxx[:, k, k]).real
        gyy = _without(self.gxx, rest, y, y, self.gyy[output]).real
        gxy = _without(self.gxx, rest, x, y, self.gxy[output][:, k])
        left = self.averages - ONE_AVERAGE * len(rest)
        return WindowSpectra(self.length, self.w, gxx, gyy, gxy, left)

    def _split(self, input: str) -> tuple[int, list[int]]:
        k = self.inputs.index(input)
        return k, [i for i in range(len(self.inputs)) if i != k]


def _without(gxx: Complex, rest: list[int], a: Complex, b: Complex, gab: Complex | Array) -> Complex:
    """G_ab.c = G_ab - G_ac Gcc^-1 G_cb (n_w,), c the inputs `rest`; a, b (n_w, n_rest): G_ca, G_cb."""
    if not rest:
        return np.asarray(gab, dtype=np.complex128)
    inverse = _inverse(gxx[:, rest][:, :, rest])
    taken = np.einsum("wi,wij,wj->w", a.conj(), inverse, b)
    return np.asarray(gab - taken, dtype=np.complex128)


def _inverse(g: Complex) -> Complex:
    """Pseudo-inverse (n_w, n, n) of input spectra, scaled by their power; inputs without power give 0."""
    usable = np.all(np.isfinite(g), axis=(1, 2))
    g = np.where(usable[:, None, None], g, np.eye(g.shape[-1]))
    power = np.sqrt(np.einsum("wii->wi", g).real)
    power[power == 0] = 1.0
    scale = power[:, :, None] * power[:, None, :]
    inverse = np.linalg.pinv(g / scale, rcond=1e-9, hermitian=True) / scale
    return np.asarray(np.where(usable[:, None, None], inverse, np.nan), dtype=np.complex128)


def input_spectra(
    runs: Sequence[Mapping[str, Signal]],
    spans: Sequence[tuple[float, float]],
    inputs: Sequence[str],
    outputs: Sequence[str],
    lengths: Sequence[float],
    w: Array,
) -> tuple[InputSpectra, ...]:
    """Averaged spectra of all inputs and outputs for each window length [s] at w [rad/s], over all runs.

    runs: {channel: signal} within the spans (start, end) [s]. Each window lies within one run. Lengths that
    leave less than one independent average for each input are left out. ValueError when the longest remaining
    window does not resolve the lowest w.
    """
    averages = {n: effective_averages(spans, n) for n in lengths}
    used = [n for n in lengths if averages[n] >= ONE_AVERAGE * len(inputs) * (1 - 1e-9)]
    if not used or w[0] < 2 * np.pi / max(used) * (1 - 1e-9):
        total = sum(end - start for start, end in spans)
        raise ValueError(
            f"{total:g} s of runs are too short for {len(inputs)} input{'s' * (len(inputs) > 1)} down to "
            f"{w[0]:g} rad/s: drive longer runs or raise the lowest frequency"
        )
    sums: list[Any] = [0.0] * len(used)
    counts, grids = [0] * len(used), [w] * len(used)
    for channels, span in zip(runs, spans, strict=True):
        for transform, which in _transformers(span, used, w):
            parts = [transform(channels[name]) for name in (*inputs, *outputs)]
            for k, *z in zip(which, *parts, strict=True):
                pairs = [(a, b) for a in z[: len(inputs)] for b in z] + [(y, y) for y in z[len(inputs) :]]
                sums[k] = sums[k] + np.array([np.sum(a.conj() * b, axis=0) for a, b in pairs])
                counts[k], grids[k] = counts[k] + len(z[0]), transform.w
    found = []
    for length, total, count, grid in zip(used, sums, counts, grids, strict=True):
        scale = 2.0 / length / count * np.where(w >= 2 * np.pi / length * (1 - 1e-9), 1.0, np.nan)
        g: Any = scale * (total if grid is w else sinc_interpolated(grid, total, w))
        size = len(inputs) * (len(inputs) + len(outputs))
        gx, gyy = g[:size].reshape(len(inputs), -1, w.size), dict(zip(outputs, g[size:].real, strict=True))
        gxy = {o: gx[:, len(inputs) + k].T for k, o in enumerate(outputs)}
        gxx = np.moveaxis(gx[:, : len(inputs)], -1, 0)
        found.append(InputSpectra(length, w, tuple(inputs), gxx, gxy, gyy, averages[length]))
    return tuple(found)
