"""Noise of a run: cross-spectra of the residuals of a fit, and new random noise with these spectra."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, Signal
from rover_sweep.spectra.windowed import Complex, Transformer, hann

RESOLUTION = 10.0  # s, window of the residuals' spectra; resolution 4 pi/10 rad/s
HANN_POWER = 0.375  # mean square of a Hann window


@dataclass(frozen=True, eq=False)
class NoiseSpectra:
    """Noise of one run: stationary noise times a level that varies slowly in time.

    density (n_w, n_outputs, n_outputs): two-sided cross-spectra, unit^2 s, at w (n_w,) [rad/s]; level
    (n_outputs, n_times) at t (n_times,) [s], with mean square 1.
    """

    w: Array
    density: Complex
    t: Array
    level: Array


class ResidualSpectra:
    """Cross-spectra of residuals of one run over `span` (start, end) [s], up to w_max [rad/s]."""

    def __init__(self, span: tuple[float, float], w_max: float) -> None:
        self.length = min(RESOLUTION, (span[1] - span[0]) / 3)
        lowest = 2 * np.pi / self.length
        self.w = np.linspace(lowest, w_max, max(int((w_max - lowest) / lowest), 4))
        self.transform = Transformer(*span, [self.length], self.w)

    def __call__(self, residuals: Sequence[Signal]) -> NoiseSpectra:
        e = np.array([self.transform(r)[0] for r in residuals])
        power = np.mean(np.abs(e) ** 2, axis=2) + 1e-300
        level = np.sqrt(power / np.mean(power, axis=1, keepdims=True))
        e = e / level[:, :, None]
        density = np.einsum("ikw,jkw->wij", e, e.conj()) / e.shape[1] / (HANN_POWER * self.length)
        centres = self.transform.windows[0][0] + self.length / 2
        return NoiseSpectra(self.w, density, centres, level)


class CoarseTransformer:
    """Fourier transforms at w (n_w,) [rad/s] of every window, for many band-limited signals at once.

    The signals (m, n) are sampled at t (n,) [s], just fast enough for w_top [rad/s]. windows: (starts,
    length) [s] of each length.
    """

    def __init__(
        self, span: tuple[float, float], windows: Sequence[tuple[Array, float]], w: Array, w_top: float
    ) -> None:
        start, end = span
        n = int(np.ceil((end - start) * 1.3 * w_top / np.pi))
        self.t = np.linspace(start, end, n)
        self.windows, self.w = windows, w
        angle = np.outer(self.t, w)
        kernel = np.concatenate((np.cos(angle), -np.sin(angle)), axis=1) * (self.t[1] - self.t[0])
        self.kernel = kernel.astype(np.float32)  # 7 digits are enough for noise
        centred = np.column_stack((np.ones(n), self.t - self.t.mean()))
        self.basis = (centred / np.linalg.norm(centred, axis=0)).astype(np.float32)

    def __call__(self, x: Array) -> Iterator[NDArray[np.complex64]]:
        """Transforms (n_windows, m, n_w) of the detrended signals, for each length."""
        plain = x.astype(np.float32)
        line = plain @ self.basis  # its transform is taken off, which is less work than its samples
        for starts, length in self.windows:
            out = np.empty((starts.size, len(plain), self.w.size), dtype=np.complex64)
            for k, start in enumerate(starts):
                both = self._window(plain, line, start, length)
                out[k].real, out[k].imag = both[:, : self.w.size], both[:, self.w.size :]
            yield out

    def _window(
        self, x: NDArray[np.float32], line: NDArray[np.float32], start: float, length: float
    ) -> NDArray[np.float32]:
        lo, hi = np.searchsorted(self.t, (start, start + length))
        taper = hann((self.t[lo:hi] - start) / length).astype(np.float32)
        kernel = taper[:, None] * self.kernel[lo:hi]
        return x[:, lo:hi] @ kernel - line @ (self.basis[lo:hi].T @ kernel)


def fresh_noise(
    spectra: NoiseSpectra,
    t: Array,
    w_top: float,
    count: int,
    integrated: Sequence[bool],
    rng: np.random.Generator,
) -> Array:
    """Gaussian noise (count, n_outputs, n_t) at even t (n_t,) [s], with these spectra up to w_top [rad/s].

    At each frequency the Cholesky factor of the density times independent complex normal numbers, then the
    inverse FFT. integrated: outputs to return as their integral. The noise has a period of twice the
    record, its level mirrored at the end.
    """
    period = 2 * t.size * (t[1] - t[0])
    w = 2 * np.pi / period * np.arange(1, int(w_top * period / (2 * np.pi)) + 1)
    root = _roots(spectra, w) * np.sqrt(period)
    shape = (w.size, root.shape[-1], count)
    z = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
    lines = np.zeros((count, root.shape[-1], t.size + 1), dtype=complex)
    lines[:, :, 1 : w.size + 1] = (root @ z).transpose(2, 1, 0)
    level = np.array([np.interp(t, spectra.t, row) for row in spectra.level])
    x = np.fft.irfft(lines, 2 * t.size) * (2 * t.size / period)
    x *= np.concatenate((level, level[:, ::-1]), axis=1)
    for k in np.flatnonzero(integrated):
        x[:, k] = _integral(x[:, k], period)
    return x[:, :, : t.size]


def _integral(x: Array, period: float) -> Array:
    """The periodic integral (count, n) of x minus its mean."""
    lines = np.fft.rfft(x)
    lines[:, 0] = 0
    lines[:, 1:] /= 2j * np.pi / period * np.arange(1, lines.shape[1])
    return np.fft.irfft(lines, x.shape[1])


def _roots(spectra: NoiseSpectra, w: Array) -> Complex:
    """Cholesky factors (n, n_outputs, n_outputs) of the density at w."""
    n = spectra.density.shape[1]
    density = np.empty((w.size, n, n), dtype=complex)
    for i in range(n):
        for j in range(n):
            density[:, i, j] = np.interp(w, spectra.w, spectra.density[:, i, j])
    power = np.einsum("wii->wi", density).real
    return np.linalg.cholesky(density + (1e-9 * power[:, :, None] + 1e-30) * np.eye(n))
