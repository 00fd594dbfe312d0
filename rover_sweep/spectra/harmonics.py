"""2nd and 3rd harmonics from one run of an odd multisine: responses at frequencies it does not excite.

Pintelon and Schoukens, System Identification: A Frequency Domain Approach (2012), section 4.3. Over P whole
periods of a periodic wave, the response lies at multiples (lines) of the base frequency w0. The linear part
is at the excited lines, even nonlinearities (an asymmetric linkage, the drag of cornering) at even lines, odd
ones (play, saturation) at odd lines, visible at those that are not excited. Noise is at all frequencies; the
P - 1 frequencies between two lines hold noise only, which gives the noise floor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, Complex, Mask, Recording, Signal
from rover_sweep.data.results import ShortTable, Shown
from rover_sweep.errors import DataRefused
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.spectra.windowed import Transformer, hann

CHANNELS = ("pwm", "r", "ay", "p", "phi", "speed")
STEP = 0.01  # s: grid of the search for the wave
MIN_CORRELATION = 0.95  # of the recorded steering with the multisine
TOP_SHARE = 0.7  # of the Nyquist frequency of a channel: its highest line
RATE_SHARE = 8.0  # samples per period of the highest line; faster samples are averaged
NEIGHBOURS = 12  # frequencies on each side of a line that give its noise floor
SIGNIFICANCE = 0.001  # probability of such a level from noise only


@dataclass(frozen=True, eq=False)
class LineLevels:
    """Levels of one channel at frequencies w (n,) [rad/s]: level (n,) in unit, the rms of the sine.

    excited, even, odd, between: masks (n,) of excited lines, even lines, odd lines not excited, frequencies
    between lines. even_chance, odd_chance: probability that noise alone is as strong at the even lines, at
    the odd lines not excited.
    """

    channel: str
    unit: str
    w: Array
    level: Array
    excited: Mask
    even: Mask
    odd: Mask
    between: Mask
    even_chance: float
    odd_chance: float

    def db(self, lines: Mask) -> float:
        """Rms level over a mask: `excited`, `even`, `odd` or `between`; dB re 1 unit."""
        return float(10 * np.log10(np.mean(self.level[lines] ** 2))) if lines.any() else math.nan

    @property
    def second(self) -> float:
        """2nd harmonic: level at even lines over that at excited lines, dB, noise included (see `noise`)."""
        return self.db(self.even) - self.db(self.excited)

    @property
    def third(self) -> float:
        """3rd harmonic: level at odd lines not excited over that at excited lines, dB, noise included."""
        return self.db(self.odd) - self.db(self.excited)

    @property
    def noise(self) -> float:
        """Noise floor: level between the lines over that at excited lines, dB."""
        return self.db(self.between) - self.db(self.excited)

    @property
    def second_detected(self) -> bool:
        """True when the even lines are above the noise."""
        return self.even_chance < SIGNIFICANCE

    @property
    def third_detected(self) -> bool:
        """True when the odd lines that are not excited are above the noise."""
        return self.odd_chance < SIGNIFICANCE


@dataclass(frozen=True, eq=False, repr=False)
class Harmonics(Shown):
    """Levels of the channels of one run of a multisine. start [s]: T_rec begins here in the recording."""

    run: str
    start: float
    channels: tuple[LineLevels, ...]

    def __getitem__(self, channel: str) -> LineLevels:
        return next(c for c in self.channels if c.channel == channel)

    def table(self) -> ShortTable:
        """A row for each channel, dB; a star marks levels above the noise."""
        rows = tuple(
            (
                c.channel,
                f"{c.db(c.excited):.1f} re 1 {c.unit}",
                f"{c.second:.1f}{'*' * c.second_detected}",
                f"{c.third:.1f}{'*' * c.third_detected}",
                f"{c.noise:.1f}",
            )
            for c in self.channels
        )
        headings = ("channel", "excited, dB", "2nd (even lines)", "3rd (odd lines)", "noise")
        note = "2nd, 3rd, noise: dB re the excited lines; * above the noise (chance below 0.1 %)"
        return ShortTable(f"harmonics of {self.run}", headings, rows, (note,))


def harmonics(run: Recording, multisine: Multisine, channels: Sequence[str] = CHANNELS) -> Harmonics:
    """Levels of the recorded channels at the lines of a multisine and between them, over the whole T_rec.

    run: one of `rs.read(...)`, driven with this multisine. Sines are fitted by least squares on each
    channel's own time stamps (a PWM by the integral of its steps), up to the end of the band or .7 of the
    channel's Nyquist frequency. The levels of pwm are in the steering output itself; only what exceeds them
    comes from the vehicle. DataRefused when the recording does not hold the whole multisine.

    >>> rs.harmonics(runs["run1"], rs.Multisine(amplitude=240))  # run1 is a sweep
    Traceback (most recent call last):
    rover_sweep.errors.DataRefused: run1: the steering is not this multisine...
    """
    start = law_start(run, multisine)
    end = start + multisine.t_rec
    recorded = [c for c in channels if c in run]
    for c in recorded:
        t = run[c].between(start, end).t
        if t.size < 2 or t[0] > start + 1.0 or t[-1] < end - 1.0 or np.max(np.diff(t)) > 1.0:
            raise DataRefused(f"{run.name}: {c} was not recorded over the whole multisine")
    levels = tuple(_levels(c, run[c], multisine, start) for c in recorded)
    return Harmonics(run.name, start, levels)


def law_start(run: Recording, multisine: Multisine) -> float:
    """Time [s] in the recording at which T_rec begins, by correlation of the steering with the wave.

    DataRefused when the correlation is below .95.
    """
    name = "pwm" if "pwm" in run else "delta"
    wave_t = np.arange(multisine.straight, multisine.duration - multisine.straight, STEP)
    wave = multisine.wave(wave_t)
    first = run.span[0] - 1.0
    grid = np.arange(first, max(run.span[1] + 1.0, first + wave_t[-1] - wave_t[0] + STEP), STEP)
    x = run[name].on(grid)
    x = x - np.median(x)
    size = 2 ** math.ceil(math.log2(grid.size + wave.size))
    product = np.fft.irfft(np.fft.rfft(x, size) * np.fft.rfft(wave, size).conj(), size)[: grid.size]
    power = np.concatenate(([0.0], np.cumsum(x**2)))
    held = power[np.minimum(np.arange(grid.size) + wave.size, grid.size)] - power[: grid.size]
    correlation = np.abs(product) / np.sqrt(np.maximum(held, 1e-12 * power[-1] + 1e-300) * np.sum(wave**2))
    correlation[held < 0.5 * power[-1]] = 0.0
    best = int(np.argmax(correlation))
    if correlation[best] < MIN_CORRELATION:
        raise DataRefused(
            f"{run.name}: the steering is not this multisine (correlation {correlation[best]:.2f}); give the "
            "amplitude, band, T_rec and periods of the driven one, and a recording of the whole run"
        )
    return float(grid[best] + multisine.fade + multisine.dwell)


def _levels(name: str, signal: Signal, multisine: Multisine, start: float) -> LineLevels:
    """Levels of a channel at all multiples of w0/P up to its highest line."""
    periods = int(multisine.periods)
    top = min(int(multisine.odd[-1]) * multisine.base, TOP_SHARE * np.pi * signal.rate)
    m = np.arange(1, int(top / multisine.base * periods + 1e-6) + 1)
    w = m * multisine.base / periods
    part = signal.between(start, start + multisine.t_rec)
    amplitude = _staircase_lines(part, w, start, multisine.t_rec) if signal.hold else _sampled_lines(part, w)
    power = np.abs(amplitude) ** 2 / 2
    band = (m >= multisine.odd[0] * periods) & (m <= multisine.odd[-1] * periods)
    excited, even, odd = (
        band & np.isin(m, lines * periods)
        for lines in (multisine.lines, multisine.even, multisine.odd_left_out)
    )
    between = band & (m % periods != 0)
    noise = _noise(power, between)
    chances = (_chance(power, noise, lines, between) for lines in (even, odd))
    return LineLevels(name, signal.unit, w, np.sqrt(power), excited, even, odd, between, *chances)


def _staircase_lines(steps: Signal, w: Array, start: float, length: float) -> Complex:
    """Complex amplitudes (n_w,) of a staircase over `length` s from `start`, by its Fourier integral."""
    edges = np.append(steps.t, start + length)
    turned = np.exp(-1j * np.outer(w, edges - start))
    held = (turned[:, :-1] - turned[:, 1:]) / (1j * w[:, None])
    return np.asarray(held @ (steps.x - steps.x.mean()) * 2 / length)


def _sampled_lines(samples: Signal, w: Array) -> Complex:
    """Complex amplitudes (n_w,) of sines at w [rad/s], fitted to the samples with a straight line."""
    # samples much faster than the lines are averaged in groups, which lowers all lines equally
    n = max(int(samples.rate * 2 * math.pi / float(w[-1]) / RATE_SHARE), 1)
    whole = samples.t.size // n * n
    t, x = (a[:whole].reshape(-1, n).mean(axis=1) for a in (samples.t, samples.x))
    t = t - t[0]
    turned = np.outer(t, w)
    basis = np.hstack((np.ones((t.size, 1)), (t / t[-1])[:, None], np.cos(turned), np.sin(turned)))
    if basis.shape[1] > t.size:
        raise DataRefused(
            f"{samples.source or 'a channel'}: {t.size} samples are too few for {w.size} frequencies"
        )
    found = np.linalg.lstsq(basis, x, rcond=None)[0][2:]
    return np.asarray(found[: w.size] - 1j * found[w.size :])


def _noise(power: Array, between: Mask) -> Array:
    """Noise power (n,) at every frequency: mean over the nearest frequencies between lines."""
    k = np.flatnonzero(between)
    total = np.concatenate(([0.0], np.cumsum(power[k])))
    at = np.searchsorted(k, np.arange(power.size))
    lo, hi = np.maximum(at - NEIGHBOURS, 0), np.minimum(at + NEIGHBOURS, k.size)
    return np.asarray((total[hi] - total[lo]) / (hi - lo))


def _chance(power: Array, noise: Array, lines: Mask, between: Mask) -> float:
    """Probability that noise alone is as strong at these lines: F test of their power over the noise."""
    from scipy.special import fdtrc

    count = int(lines.sum())
    if not count:
        return 1.0
    ratio = np.mean(power[lines] / noise[lines]) / np.mean(power[between] / noise[between])
    return float(fdtrc(2 * count, 2 * int(between.sum()), ratio))


# Noise of a run: cross-spectra of the residuals of a fit, and new random noise with these spectra.


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
                lo, hi = np.searchsorted(self.t, (start, start + length))
                taper = hann((self.t[lo:hi] - start) / length).astype(np.float32)
                kernel = taper[:, None] * self.kernel[lo:hi]
                both = plain[:, lo:hi] @ kernel - line @ (self.basis[lo:hi].T @ kernel)
                out[k].real, out[k].imag = both[:, : self.w.size], both[:, self.w.size :]
            yield out


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
        lines = np.fft.rfft(x[:, k])  # the periodic integral of x minus its mean
        lines[:, 0] = 0
        lines[:, 1:] /= 2j * np.pi / period * np.arange(1, lines.shape[1])
        x[:, k] = np.fft.irfft(lines, x.shape[2])
    return x[:, :, : t.size]


def _roots(spectra: NoiseSpectra, w: Array) -> Complex:
    """Cholesky factors (n, n_outputs, n_outputs) of the density at w."""
    n = spectra.density.shape[1]
    density = np.empty((w.size, n, n), dtype=complex)
    for i in range(n):
        for j in range(n):
            density[:, i, j] = np.interp(w, spectra.w, spectra.density[:, i, j])
    power = np.einsum("wii->wi", density).real
    return np.linalg.cholesky(density + (1e-9 * power[:, :, None] + 1e-30) * np.eye(n))
