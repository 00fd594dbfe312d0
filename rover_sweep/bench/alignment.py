"""Two records of one movement brought together: the lag at which the wheel follows the PWM best. Pure."""

from __future__ import annotations

from math import isfinite

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.errors import DataRefused

GRID = 0.01  # s
SPAN = 0.1  # s over which a movement is taken
LEAST = 0.5  # correlation of the two, from which they show the same thing


def first_offset(
    t: Array, pwm: Array, wheel_t: Array, value: Array, is_rate: bool, clock: float
) -> tuple[float, float]:
    """(seconds that the wheel's clock is ahead, to a few hundredths; slope of the wheel on the PWM [rad/us]).

    t, pwm (m,); wheel_t, value (n,) rad or rad/s. clock: standard deviation of the wheel's clock beside the
    rover's; inf looks everywhere. DataRefused where the wheel does not follow.
    """
    angle = (
        np.concatenate(([0.0], np.cumsum(np.diff(wheel_t) * 0.5 * (value[1:] + value[:-1]))))
        if is_rate
        else value
    )
    moved, seen = _movement(t, pwm, step=True), _movement(wheel_t, angle, step=False)
    if moved.size < 10 or seen.size < 10 or not moved.any() or not seen.any():
        raise DataRefused("nothing moves in the record of the steering, or in that of the wheel")
    size = 1 << int(np.ceil(np.log2(moved.size + seen.size)))
    spectrum = np.fft.rfft(seen, size) * np.conj(np.fft.rfft(moved, size))
    product = np.fft.irfft(spectrum, size)
    lags = np.arange(size)
    lags = np.where(lags > size // 2, lags - size, lags)
    ahead = (wheel_t[0] - t[0]) + lags * GRID
    if isfinite(clock):
        product = np.where(np.abs(ahead - 0.1) < 0.4 + 5 * clock, product, 0.0)
    k = int(np.argmax(np.abs(product)))
    ours = moved[max(0, -lags[k]) : max(0, seen.size - lags[k])]
    theirs = seen[max(0, lags[k]) :][: ours.size]
    ours = ours[: theirs.size]
    strength = abs(float(ours @ theirs)) / max(float(np.linalg.norm(ours) * np.linalg.norm(theirs)), 1e-12)
    if strength < LEAST:
        raise DataRefused(
            f"the wheel does not follow the steering (correlation {strength:.2f}): is it the record of this "
            "bench, is the IMU on the wheel, is the clock the rover's (--wheel-clock)?"
        )
    return float(ahead[k]), float(ours @ theirs) / float(ours @ ours)


def _movement(t: Array, x: Array, step: bool) -> Array:
    """Change over SPAN on a grid; step: held between samples."""
    grid = np.arange(t[0], t[-1], GRID)
    even = x[np.clip(np.searchsorted(t, grid, "right") - 1, 0, None)] if step else np.interp(grid, t, x)
    width = int(SPAN / GRID)
    return np.asarray(even[width:] - even[:-width]) if even.size > width else np.zeros(0)
