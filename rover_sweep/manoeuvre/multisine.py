"""An odd multisine that does not excite all odd lines, to measure 2nd and 3rd harmonics in one run.

Pintelon and Schoukens, System Identification: A Frequency Domain Approach (2012), chapter 4. Of the lines k
w0, three out of four odd ones are excited. Even nonlinearities (squares) of the vehicle respond at even
lines, odd ones (cubes) at odd lines, including those that are not excited.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Lines = NDArray[np.int64]

# Index (0 to 3) of the odd line that is not excited, for each four lines; never the lowest or two neighbours.
LEFT_OUT = (2, 1, 3, 2, 1, 2, 3, 1, 1, 3, 2, 2, 3, 1, 2, 1)
EDGE = 0.01  # of w0: a line this close to the band belongs to it
LEAST_LINES, MOST_LINES = 4, 128  # odd lines in the band
POINTS = 16  # per period of the highest line, in the search for the peak


def fading(since: Array, full: float, fade: float) -> Array:
    """Envelope 0..1 at `since` (...) [s] from the start of fade-in: fade [s], `full` [s] at 1, fade [s]."""
    left = full + 2 * fade - since
    if fade == 0:
        return np.where((since < 0) | (left < 0), 0.0, 1.0)
    return np.asarray(np.clip(np.minimum(since, left) / fade, 0.0, 1.0), dtype=np.float64)


@dataclass(frozen=True)
class Multisine:
    """Equal sines at three out of four odd multiples of w0 = 2 pi periods/t_rec, from w_min to w_max [rad/s].

    >>> wave = rs.Multisine(amplitude=240, w_max=20)
    >>> wave.lines[:4].tolist(), round(wave.base, 3)  # multiples of the base frequency [rad/s]
    ([1, 3, 7, 9], 0.343)

    amplitude: peak of the sum [us], within 2 %. Order in time: straight, fade-in, dwell (the rover settles),
    t_rec with `periods` whole periods, fade-out, straight [s]; the wave is periodic throughout. Phases by
    Schroeder (1970).
    """

    amplitude: float = 150.0
    w_min: float = 0.3
    w_max: float = 25.0
    t_rec: float = 55.0
    periods: int = 3
    fade: float = 2.0
    dwell: float = 2.0
    straight: float = 3.0
    kind: Literal["multisine"] = "multisine"

    def __post_init__(self) -> None:
        if not 0 < self.w_min < self.w_max:
            raise ValueError(f"need 0 < w_min < w_max, got w_min {self.w_min} and w_max {self.w_max} rad/s")
        if self.t_rec <= 0 or self.amplitude <= 0:
            raise ValueError(f"need t_rec > 0 and amplitude > 0, got {self.t_rec} s and {self.amplitude} us")
        if min(self.fade, self.dwell, self.straight) < 0:
            raise ValueError(
                f"fade {self.fade}, dwell {self.dwell}, straight {self.straight} s must not be negative"
            )
        if self.periods < 2 or self.periods != int(self.periods):
            raise ValueError(f"a multisine needs 2, 3 .. whole periods in t_rec, got {self.periods}")
        held = (self.w_max - self.w_min) / self.base / 2  # estimate, as a list could be too long for memory
        held = self.odd.size if held < 1e6 else held
        if not LEAST_LINES <= held <= MOST_LINES:
            raise ValueError(
                f"{self.w_min:g} to {self.w_max:g} rad/s contain {held:g} odd lines of "
                f"{self.base:.3g} rad/s, but {LEAST_LINES} to {MOST_LINES} are allowed: change t_rec or "
                "periods"
            )

    @property
    def base(self) -> float:
        """w0 [rad/s]: all lines are multiples of it."""
        return 2 * math.pi * self.periods / self.t_rec

    @property
    def odd(self) -> Lines:
        """All odd lines of the band (J,), as multiples of w0."""
        low, high = math.ceil(self.w_min / self.base - EDGE), math.floor(self.w_max / self.base + EDGE)
        return np.arange(low + 1 - low % 2, high + 1, 2)

    @property
    def even(self) -> Lines:
        """The even lines between the odd ones, not excited."""
        return self.odd[:-1] + 1

    @property
    def lines(self) -> Lines:
        """The excited lines."""
        return self.odd[self._excited]

    @property
    def odd_left_out(self) -> Lines:
        """The odd lines that are not excited."""
        return self.odd[~self._excited]

    @property
    def phases(self) -> Array:
        """Phase [rad] of each excited line at the start of t_rec: -pi j^2/J, j counting all J odd lines."""
        j, count = np.arange(self.odd.size), self.odd.size
        return np.asarray(-np.pi * (j * j % (2 * count)) / count)[self._excited]

    @property
    def _excited(self) -> NDArray[np.bool_]:
        j = np.arange(self.odd.size)
        return j % 4 != np.array(LEFT_OUT)[j // 4 % len(LEFT_OUT)]

    @cached_property
    def _sum_peak(self) -> float:
        """Peak of the sum of unit sines, on the same grid as in the applet."""
        half = POINTS // 2 * int(self.lines[-1])  # the second half period is the negative first
        points = np.arange(half)[:, None] * self.lines % (2 * half)
        return float(np.max(np.abs(np.sin(np.pi * points / half + self.phases).sum(axis=1))))

    @property
    def crest_factor(self) -> float:
        """Peak over rms of the wave: 1.8 to 3.4, usually 2.1 to 2.6 (a sine: 1.41)."""
        return self._sum_peak / math.sqrt(self.lines.size / 2)

    @property
    def line_amplitude(self) -> float:
        """Amplitude of each excited line, us."""
        return self.amplitude / self._sum_peak

    @property
    def peak(self) -> float:
        """Largest offset from trim, us."""
        return self.amplitude

    @property
    def duration(self) -> float:
        """Length of the whole override, s."""
        return 2 * self.straight + 2 * self.fade + self.dwell + self.t_rec

    @property
    def law_start(self) -> float:
        """Time from the start of the override at which T_rec begins, s."""
        return self.straight + self.fade + self.dwell

    @property
    def peak_slew(self) -> float:
        """Largest rate of the wave at the servo, us/s."""
        turned = np.arange(POINTS * int(self.lines[-1])) * (2 * np.pi / (POINTS * int(self.lines[-1])))
        rates = self.base * self.lines * np.cos(turned[:, None] * self.lines + self.phases)
        return self.line_amplitude * float(np.max(np.abs(rates.sum(axis=1))))

    def wave(self, t: Array | float) -> Array:
        """Steering offset [us] at t [s] from the start of the override."""
        since = np.asarray(t, dtype=float) - self.straight
        turned = self.base * (since - self.fade - self.dwell)
        total = np.zeros_like(turned)
        for k, phase in zip(self.lines, self.phases, strict=True):
            total += np.sin(k * turned + phase)
        return fading(since, self.dwell + self.t_rec, self.fade) * self.line_amplitude * total
