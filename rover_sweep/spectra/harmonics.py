"""2nd and 3rd harmonics at once: what a vehicle answers where an odd multisine does not excite it.

Pintelon and Schoukens, System Identification: A Frequency Domain Approach (2012), section 4.3. Over a whole
number P of periods of a wave that repeats itself, everything that follows the wave lies at multiples of its
base frequency w0: what is linear at the excited lines, what is even (squares: a lopsided linkage, the drag
of cornering) at even lines, what is odd (cubes: play, saturation) at odd ones, seen at those that were left
out. Noise lies there as well, and at the P - 1 frequencies between two lines it lies alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.data.result_table import ShortTable, Shown
from rover_sweep.errors import DataRefused
from rover_sweep.manoeuvre.multisine import Multisine

Bool = NDArray[np.bool_]
Complex = NDArray[np.complex128]

CHANNELS = ("pwm", "r", "ay", "p", "phi", "speed")
STEP = 0.01  # s: grid on which the wave is looked for, and that of a staircase
ALIKE = 0.95  # correlation of the recorded steering with the multisine
TOP_SHARE = 0.7  # of the Nyquist frequency of a channel, up to which its lines are looked at
RATE_SHARE = 8.0  # samples a period of the highest line; faster even samples are averaged
NEIGHBOURS = 12  # noise frequencies to each side that tell the noise at a line
SURE = 0.001  # chance of so high a level from noise alone


@dataclass(frozen=True, eq=False)
class LineLevels:
    """Levels of one channel at frequencies w (n,) [rad/s]: level (n,) in unit, root mean square of the sine.

    excited, even, odd, between: which of them (n,) are excited lines, even lines, odd lines left out, and
    frequencies between lines. even_chance, odd_chance: how likely noise alone would be as strong at the even
    lines, at the odd ones left out.
    """

    channel: str
    unit: str
    w: Array
    level: Array
    excited: Bool
    even: Bool
    odd: Bool
    between: Bool
    even_chance: float
    odd_chance: float

    def db(self, lines: Bool) -> float:
        """Root-mean-square level over `excited`, `even`, `odd` or `between`, dB re 1 unit."""
        return float(10 * np.log10(np.mean(self.level[lines] ** 2))) if lines.any() else math.nan

    @property
    def second(self) -> float:
        """Level at even lines over that at excited ones, dB; noise is in it, see `noise`."""
        return self.db(self.even) - self.db(self.excited)

    @property
    def third(self) -> float:
        """Level at odd lines left out over that at excited ones, dB; noise is in it, see `noise`."""
        return self.db(self.odd) - self.db(self.excited)

    @property
    def noise(self) -> float:
        """Level between the lines over that at excited ones, dB."""
        return self.db(self.between) - self.db(self.excited)

    @property
    def sees_second(self) -> bool:
        """Whether the even lines stand above the noise."""
        return self.even_chance < SURE

    @property
    def sees_third(self) -> bool:
        """Whether the odd lines left out stand above the noise."""
        return self.odd_chance < SURE


@dataclass(frozen=True, eq=False, repr=False)
class Harmonics(Shown):
    """Levels of the channels of one run of a multisine, whose law began at `start` s of the recording."""

    run: str
    start: float
    channels: tuple[LineLevels, ...]

    def __getitem__(self, channel: str) -> LineLevels:
        return next(c for c in self.channels if c.channel == channel)

    def table(self) -> ShortTable:
        """A row a channel, dB; a star where a level stands above the noise."""
        rows = tuple(
            (
                c.channel,
                f"{c.db(c.excited):.1f} re 1 {c.unit}",
                f"{c.second:.1f}{'*' * c.sees_second}",
                f"{c.third:.1f}{'*' * c.sees_third}",
                f"{c.noise:.1f}",
            )
            for c in self.channels
        )
        headings = ("channel", "excited, dB", "2nd (even lines)", "3rd (odd lines)", "noise")
        note = "2nd, 3rd, noise: dB from the excited lines; * above the noise with less than 0.1 % chance"
        return ShortTable(f"harmonics of {self.run}", headings, rows, (note,))


def harmonics(run: Recording, multisine: Multisine, channels: Sequence[str] = CHANNELS) -> Harmonics:
    """Levels at excited lines, even lines, odd lines left out and between lines, of the channels recorded.

    Of the whole T_rec, by least squares on each channel's own time stamps (a PWM by the integral of its
    steps), up to the lower of the band's end and .7 of the channel's Nyquist frequency. What the table says
    of pwm is what the steering output itself held; only what exceeds it comes from the vehicle. DataRefused
    where the recording does not hold this multisine, or not all of it.
    """
    start = law_start(run, multisine)
    end = start + multisine.t_rec
    there = [c for c in channels if c in run]
    for c in there:
        t = run[c].between(start, end).t
        if t.size < 2 or t[0] > start + 1.0 or t[-1] < end - 1.0 or np.max(np.diff(t)) > 1.0:
            raise DataRefused(f"{run.name}: {c} was not recorded throughout the multisine")
    levels = tuple(_levels(c, run[c], multisine, start) for c in there)
    return Harmonics(run.name, start, levels)


def law_start(run: Recording, multisine: Multisine) -> float:
    """Time [s] in the recording at which the law of this multisine begins, found by its wave.

    DataRefused where the recorded steering is not alike.
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
    alike = np.abs(product) / np.sqrt(np.maximum(held, 1e-12 * power[-1] + 1e-300) * np.sum(wave**2))
    alike[held < 0.5 * power[-1]] = 0.0
    best = int(np.argmax(alike))
    if alike[best] < ALIKE:
        raise DataRefused(
            f"{run.name}: its steering is not this multisine (correlation {alike[best]:.2f}); give the one "
            "that was driven, with its periods, T_rec and band, or a recording of the whole run"
        )
    return float(grid[best] + multisine.fade + multisine.dwell)


def _levels(name: str, signal: Signal, multisine: Multisine, start: float) -> LineLevels:
    """The channel at every frequency of the P periods within the band."""
    periods = int(multisine.periods)
    top = min(int(multisine.odd[-1]) * multisine.base, TOP_SHARE * np.pi * signal.rate)
    m = np.arange(1, int(top / multisine.base * periods + 1e-6) + 1)
    w = m * multisine.base / periods
    part = signal.between(start, start + multisine.t_rec)
    amplitude = _staircase_lines(part, w, start, multisine.t_rec) if signal.hold else _sampled_lines(part, w)
    power = np.abs(amplitude) ** 2 / 2
    band = (m >= multisine.odd[0] * periods) & (m <= multisine.odd[-1] * periods)
    excited, even, odd = (band & np.isin(m, lines * periods) for lines in _lines(multisine))
    between = band & (m % periods != 0)
    noise = _noise(power, between)
    chances = (_chance(power, noise, lines, between) for lines in (even, odd))
    return LineLevels(name, signal.unit, w, np.sqrt(power), excited, even, odd, between, *chances)


def _lines(multisine: Multisine) -> tuple[NDArray[np.int64], ...]:
    return multisine.lines, multisine.even, multisine.odd_left_out


def _staircase_lines(steps: Signal, w: Array, start: float, length: float) -> Complex:
    """Complex amplitudes (n_w,) of a staircase over `length` s from `start`, by its Fourier integral."""
    edges = np.append(steps.t, start + length)
    turned = np.exp(-1j * np.outer(w, edges - start))
    held = (turned[:, :-1] - turned[:, 1:]) / (1j * w[:, None])
    return np.asarray(held @ (steps.x - steps.x.mean()) * 2 / length)


def _sampled_lines(samples: Signal, w: Array) -> Complex:
    """Complex amplitudes (n_w,) of sines at w [rad/s] fitted to the samples all at once, beside a line."""
    t, x = _thinned(samples, float(w[-1]))
    t = t - t[0]
    turned = np.outer(t, w)
    basis = np.hstack((np.ones((t.size, 1)), (t / t[-1])[:, None], np.cos(turned), np.sin(turned)))
    if basis.shape[1] > t.size:
        raise DataRefused(f"{samples.source or 'a channel'}: {t.size} samples are too few for {w.size} lines")
    found = np.linalg.lstsq(basis, x, rcond=None)[0][2:]
    return np.asarray(found[: w.size] - 1j * found[w.size :])


def _thinned(samples: Signal, w_top: float) -> tuple[Array, Array]:
    """Samples far faster than the lines as means of several, which costs all lines alike."""
    n = max(int(samples.rate * 2 * math.pi / w_top / RATE_SHARE), 1)
    whole = samples.t.size // n * n
    t, x = (a[:whole].reshape(-1, n).mean(axis=1) for a in (samples.t, samples.x))
    return t, x


def _noise(power: Array, between: Bool) -> Array:
    """Noise power (n,) at every frequency: the mean of those between lines around it."""
    k = np.flatnonzero(between)
    total = np.concatenate(([0.0], np.cumsum(power[k])))
    at = np.searchsorted(k, np.arange(power.size))
    lo, hi = np.maximum(at - NEIGHBOURS, 0), np.minimum(at + NEIGHBOURS, k.size)
    return np.asarray((total[hi] - total[lo]) / (hi - lo))


def _chance(power: Array, noise: Array, lines: Bool, between: Bool) -> float:
    """Chance that noise alone is as strong at these lines: F test of power over the noise around."""
    from scipy.special import fdtrc

    count = int(lines.sum())
    if not count:
        return 1.0
    ratio = np.mean(power[lines] / noise[lines]) / np.mean(power[between] / noise[between])
    return float(fdtrc(2 * count, 2 * int(between.sum()), ratio))
