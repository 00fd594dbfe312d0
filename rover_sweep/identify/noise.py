"""Noise of a run: its cross-spectra from the residuals of a fit, and fresh noise of the same spectra."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.identify.recording import Array, Signal
from rover_sweep.identify.spectra import Complex, Transformer, hann

RESOLUTION = 10.0  # s, window of the residuals' spectra: noise is taken as smooth over 4 pi/10 rad/s
HANN_POWER = 0.375  # mean square of a Hann window


@dataclass(frozen=True, eq=False)
class NoiseSpectra:
    """Two-sided cross-spectral density (n_w, n_outputs, n_outputs), unit^2 s, at w [rad/s] of one run."""

    w: Array
    density: Complex


class ResidualSpectra:
    """Cross-spectra of the residuals of one run over `span` [s], up to w_max [rad/s]."""

    def __init__(self, span: tuple[float, float], w_max: float) -> None:
        self.length = min(RESOLUTION, (span[1] - span[0]) / 3)
        lowest = 2 * np.pi / self.length
        self.w = np.linspace(lowest, w_max, max(int((w_max - lowest) / lowest), 4))
        self.transform = Transformer(*span, [self.length], self.w)

    def __call__(self, residuals: Sequence[Signal]) -> NoiseSpectra:
        e = np.array([self.transform(r)[0] for r in residuals])
        density = np.einsum("ikw,jkw->wij", e, e.conj()) / e.shape[1] / (HANN_POWER * self.length)
        return NoiseSpectra(self.w, density)


class CoarseTransformer:
    """Transforms of band-limited signals at w [rad/s] of every window: many signals at once.

    The signals (m, n) are on the clock `t` (n,), just fast enough for the band up to w_top [rad/s].
    """

    def __init__(
        self, span: tuple[float, float], windows: Sequence[tuple[Array, float]], w: Array, w_top: float
    ) -> None:
        start, end = span
        n = int(np.ceil((end - start) * 1.3 * w_top / np.pi))
        self.t = np.linspace(start, end, n)
        self.windows, self.w = windows, w
        angle = np.outer(self.t, w)
        self.kernel = np.concatenate((np.cos(angle), -np.sin(angle)), axis=1) * (self.t[1] - self.t[0])
        centred = np.column_stack((np.ones(n), self.t - self.t.mean()))
        self.basis = centred / np.linalg.norm(centred, axis=0)

    def __call__(self, x: Array) -> list[Complex]:
        """A list, per length, of (n_windows, m, n_w) arrays."""
        x = x - (x @ self.basis) @ self.basis.T
        return [np.array([self._window(x, s, length) for s in starts]) for starts, length in self.windows]

    def _window(self, x: Array, start: float, length: float) -> Complex:
        lo, hi = np.searchsorted(self.t, (start, start + length))
        taper = hann((self.t[lo:hi] - start) / length)
        both = x[:, lo:hi] @ (taper[:, None] * self.kernel[lo:hi])
        n = self.w.size
        return both[:, :n] + 1j * both[:, n:]


def fresh_noise(
    spectra: NoiseSpectra, t: Array, w_top: float, count: int, integrated: Sequence[bool],
    rng: np.random.Generator,
) -> Array:  # fmt: skip
    """Gaussian noise (count, n_outputs, n_t) on the uniform clock t [s] with these spectra up to w_top.

    integrated: which outputs are wanted as their integral. The noise repeats after twice the record.
    """
    period = 2 * t.size * (t[1] - t[0])
    w = 2 * np.pi / period * np.arange(1, int(w_top * period / (2 * np.pi)) + 1)
    root = _roots(spectra, w) * np.sqrt(period)
    rise = np.where(np.array(integrated), 1 / (1j * w[:, None]), 1.0)
    shape = (count, w.size, root.shape[-1])
    z = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)
    lines = np.einsum("wij,bwj->biw", root * rise[:, :, None], z)
    full = np.zeros((*lines.shape[:2], t.size + 1), dtype=complex)
    full[:, :, 1 : w.size + 1] = lines
    return np.fft.irfft(full, 2 * t.size)[:, :, : t.size] * (2 * t.size / period)


def _roots(spectra: NoiseSpectra, w: Array) -> Complex:
    """Cholesky factors (n, n_outputs, n_outputs) of the density at w."""
    n = spectra.density.shape[1]
    density = np.empty((w.size, n, n), dtype=complex)
    for i in range(n):
        for j in range(n):
            density[:, i, j] = np.interp(w, spectra.w, spectra.density[:, i, j])
    power = np.einsum("wii->wi", density).real
    return np.linalg.cholesky(density + (1e-9 * power[:, :, None] + 1e-30) * np.eye(n))
