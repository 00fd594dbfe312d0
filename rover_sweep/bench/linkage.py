"""From a servo's PWM to the road wheel's angle: curve, lag with a rate limit, play. Pure.

The same order and signs as the effects of the diagnosis: u = -k (pwm - trim) [rad, left positive], a deadband
of half width w, (1 +- e) left and right, 1 + c3 u^2, then the servo, then play of half gap b.
"""

from __future__ import annotations

from math import exp

import numpy as np
from numba import njit

from rover_sweep.data.recording import Array


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
