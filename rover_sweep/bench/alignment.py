"""Aligns two records of one movement, by the lag at which the wheel follows the PWM best. Pure."""

from __future__ import annotations

from math import isfinite

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.errors import DataRefused

GRID = 0.01  # s
SPAN = 0.1  # s over which a movement is taken
LEAST = 0.5  # least correlation of two records of the same movement


def first_offset(
    t: Array, pwm: Array, wheel_t: Array, value: Array, is_rate: bool, clock: float
) -> tuple[float, float]:
    """(how far the wheel's clock is ahead of the rover's [s], to a few hundredths; slope of the wheel's angle
    on the PWM [rad/us]).

    t (m,) s, pwm (m,) us; wheel_t (n,) s, value (n,) rad or, with is_rate, rad/s. clock: standard deviation
    of the clocks' offset [s]; inf: search everywhere. DataRefused if the wheel does not follow.
    """
    angle = (
        np.concatenate(([0.0], np.cumsum(np.diff(wheel_t) * 0.5 * (value[1:] + value[:-1]))))
        if is_rate
        else value
    )
    moved, followed = _movement(t, pwm, step=True), _movement(wheel_t, angle, step=False)
    if moved.size < 10 or followed.size < 10 or not moved.any() or not followed.any():
        raise DataRefused("there is no movement in the record of the steering, or in that of the wheel")
    size = 1 << int(np.ceil(np.log2(moved.size + followed.size)))
    spectrum = np.fft.rfft(followed, size) * np.conj(np.fft.rfft(moved, size))
    product = np.fft.irfft(spectrum, size)
    lags = np.arange(size)
    lags = np.where(lags > size // 2, lags - size, lags)
    ahead = (wheel_t[0] - t[0]) + lags * GRID
    if isfinite(clock):
        product = np.where(np.abs(ahead - 0.1) < 0.4 + 5 * clock, product, 0.0)
    k = int(np.argmax(np.abs(product)))
    ours = moved[max(0, -lags[k]) : max(0, followed.size - lags[k])]
    theirs = followed[max(0, lags[k]) :][: ours.size]
    ours = ours[: theirs.size]
    strength = abs(float(ours @ theirs)) / max(float(np.linalg.norm(ours) * np.linalg.norm(theirs)), 1e-12)
    if strength < LEAST:
        raise DataRefused(
            f"the wheel does not follow the steering (correlation {strength:.2f}): check that the "
            "wheel's record is from this bench, that the IMU is on the wheel, and that --wheel-clock is right"
        )
    return float(ahead[k]), float(ours @ theirs) / float(ours @ ours)


def _movement(t: Array, x: Array, step: bool) -> Array:
    """Change of x over SPAN on a grid of GRID; step: x is held between samples."""
    grid = np.arange(t[0], t[-1], GRID)
    even = x[np.clip(np.searchsorted(t, grid, "right") - 1, 0, None)] if step else np.interp(grid, t, x)
    width = int(SPAN / GRID)
    return np.asarray(even[width:] - even[:-width]) if even.size > width else np.zeros(0)
