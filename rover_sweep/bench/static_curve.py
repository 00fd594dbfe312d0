"""From the fitted static curve to the numbers of a vehicle file. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import exp, isfinite

import numpy as np
from numba import njit

from rover_sweep.bench.bench_folder import Number, interval
from rover_sweep.data.recording import Array
from rover_sweep.errors import DataRefused

# Aligns two records of one movement, by the lag at which the wheel follows the PWM best. Pure.


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


# From a servo's PWM to the road wheel's angle: curve, lag with a rate limit, play. Pure.
#
# The same order and signs as the effects of the diagnosis: u = -k (pwm - trim) [rad, left positive], a
# deadband of half width w, (1 +- e) left and right, 1 + c3 u^2, then the servo, then play of half gap b.


def curve(u: Array, e: float, c3: float, w: float) -> Array:
    """Target angle of the servo (n,) rad; u (n,) rad. A negative w is allowed: the fit may cross 0."""
    sign = 1.0 if w >= 0 else -1.0
    inside = u - sign * np.clip(u, -abs(w), abs(w))
    uneven = inside + e * np.abs(inside)
    return uneven * (1.0 + c3 * uneven * uneven)


@njit(cache=True, nogil=True)
def wheel_behind_gap(servo: Array, half_gap: float) -> Array:
    """Wheel (n,) rad behind a servo that goes from one angle to the next; begins in the middle of the gap."""
    out = np.empty(servo.size)
    x = servo[0]
    for k in range(servo.size):
        x = min(max(x, servo[k] - half_gap), servo[k] + half_gap)
        out[k] = x
    return out


@njit(cache=True, nogil=True)
def driven(
    due: Array, target: Array, t: Array, lag: float, slowness: float, half_gap: float, begin: float
) -> Array:
    """Wheel (n,) rad at the times t: targets (m,) rad come due at `due` (m,) s, exactly solved between.

    slowness: 1/rate limit [s/rad]. Begins at rest at the first target, the wheel `begin` rad from the middle
    of the gap.
    """
    out = np.empty(t.size)
    servo = target[0]
    x = servo + min(max(begin, -half_gap), half_gap)
    goal, now, j = target[0], t[0], 0
    for k in range(t.size):
        while True:
            end = t[k]
            arrives = j < due.size and due[j] <= end
            if arrives:
                end = max(due[j], now)
            dt = end - now
            if dt > 0.0 and goal != servo:
                size = abs(goal - servo)
                if slowness > 0.0:
                    knee = lag / slowness
                    if size > knee:
                        slewing = min(dt, (size - knee) * slowness)
                        size -= slewing / slowness
                        dt -= slewing
                if dt > 0.0:
                    size = size * exp(-dt / lag) if lag > 1e-6 else 0.0
                servo = goal - size if goal > servo else goal + size
                x = min(max(x, servo - half_gap), servo + half_gap)
            now = end
            if not arrives:
                break
            goal = target[j]
            j += 1
        out[k] = x
    return out


MEANINGS = {
    "trim": ("trim_us", "us", "PWM at which the wheels point straight ahead"),
    "e": ("asymmetry", "-", "gain (1 + e) to the left, (1 - e) to the right"),
    "c3": ("nonlinearity", "1/rad^2", "gain 1 + c3 u^2"),
    "w": ("deadband", "rad", "half width of the band about the trim in which the wheels do not move"),
    "b": ("backlash", "rad", "half of the gap, at the road wheel"),
}
NOT_NEGATIVE = ("w", "b")


def static_numbers(
    names: Sequence[str], x: Array, covariance: Array, factor: float, reach: float
) -> tuple[Number, ...]:
    """rad_per_us over +-`reach` us and at its centre, on either side, and the other fitted numbers.

    names: of x (n,); covariance (n, n); factor: half an interval in standard deviations.
    """

    def of(function: Callable[[dict[str, float]], float]) -> tuple[float, float]:
        """A function of the fitted numbers, and its standard deviation to first order."""
        deviation = np.sqrt(np.diag(covariance))
        here = function(dict(zip(names, x, strict=True)))
        slopes = np.zeros(len(names))
        for k in range(len(names)):
            stride = max(1e-3 * float(deviation[k]), 1e-12)
            moved = x.copy()
            moved[k] += stride
            slopes[k] = (function(dict(zip(names, moved, strict=True))) - here) / stride
        return here, float(np.sqrt(max(float(slopes @ covariance @ slopes), 0.0)))

    def angle(q: dict[str, float], offset: float) -> float:
        u = np.array([-q["k"] * offset])
        return float(curve(u, q.get("e", 0.0), q.get("c3", 0.0), q.get("w", 0.0))[0])

    def mean(q: dict[str, float]) -> float:
        return (angle(q, -reach) - angle(q, reach)) / (2 * reach)

    slope = interval("rad_per_us", "rad/us", *of(mean), factor, f"mean slope over +-{reach:.0f} us")
    out = [slope]
    if "c3" in names or "w" in names:
        out.append(
            interval("centre", "rad/us", *of(lambda q: q["k"]), factor, "slope u/PWM before the curve")
        )
    if "e" in names:
        out.append(
            interval(
                "left",
                "rad/us",
                *of(lambda q: angle(q, -reach) / reach),
                factor,
                f"mean slope to {reach:.0f} us on the left",
            )
        )
        out.append(
            interval(
                "right",
                "rad/us",
                *of(lambda q: -angle(q, reach) / reach),
                factor,
                f"mean slope to {reach:.0f} us on the right",
            )
        )
    for name, (title, unit, meaning) in MEANINGS.items():
        if name in names:
            k = list(names).index(name)
            sd = float(np.sqrt(covariance[k, k]))
            least = 0.0 if name in NOT_NEGATIVE else -np.inf
            out.append(interval(title, unit, float(x[k]), sd, factor, meaning, f"steering.{title}", least))
    return tuple(out)
