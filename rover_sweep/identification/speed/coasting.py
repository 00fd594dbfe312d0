"""Drag with the throttle at neutral, from the coasting after a sweep, and the dead zone that follows from
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.data.throttle_run import ThrottleRun
from rover_sweep.identification.speed.speed_fit import NORMAL_90, SpeedFit
from rover_sweep.identification.speed.speed_noise import SpeedNoise

NEUTRAL = 0.006  # share of full throttle: 2 us of 400
SETTLING = 0.15  # s after the delay, in which the motor controller may still act
SLOWEST, SHORTEST = 0.3, 0.4  # m/s, s
STEP = 0.04  # s


@dataclass(frozen=True)
class Coasting:
    """Coasting at `speed` [m/s], the middle of what was coasted: deceleration [m/s^2] with 90 % interval,
    over `seconds` [s]. dead_zone: throttle (share of full) that only the motor controller's dead zone takes,
    with interval; None if the rover slows down less than when it drives, so the motor is freewheeling."""

    speed: float
    deceleration: float
    interval: tuple[float, float]
    seconds: float
    dead_zone: float | None = None
    dead_zone_interval: tuple[float, float] | None = None


def coasting(runs: Sequence[ThrottleRun], found: SpeedFit) -> Coasting | None:
    """The longest coasting of the runs; None without 0.4 s of it above 0.3 m/s."""
    stretches = [s for run in runs if (s := _stretch(run, found.model.delay)) is not None]
    if not stretches:
        return None
    t, v = max(stretches, key=lambda s: s[0].size)
    middle = float(0.5 * (v.max() + v.min()))
    rate, error = _rate_at(t, v, middle, found.model.lag, found.noise)
    ends = rate - NORMAL_90 * error, rate + NORMAL_90 * error
    model = found.model
    # under drive v' = (K u - K u_drag - v) / T; coasting with the same drag gives u_drag
    dragging = (model.lag * rate - middle) / model.gain
    zone = model.offset - dragging
    spread = NORMAL_90 * _zone_error(found, rate, error, middle)
    freewheels = dragging + spread < 0
    return Coasting(
        middle,
        rate,
        ends,
        float(t[-1] - t[0]),
        None if freewheels else zone,
        None if freewheels else (zone - spread, zone + spread),
    )


def _stretch(run: ThrottleRun, delay: float) -> tuple[Array, Array] | None:
    """Times (n,) [s] and speeds (n,) with the throttle at neutral, after the sweep and above walking pace."""
    last = min(run.speed.t[-1], run.pwm.t[-1])
    t = np.arange(run.span[1], last, STEP)
    if t.size < 2:
        return None
    u = (run.pwm.x[np.searchsorted(run.pwm.t, t, "right") - 1] - run.neutral_us) / run.travel_us
    off = np.abs(u) <= NEUTRAL
    if not off.any():
        return None
    first = int(np.argmax(off))
    released = np.flatnonzero(~off[first:])
    end = first + int(released[0]) if released.size else t.size
    t = t[first:end]
    t = t[t >= t[0] + delay + SETTLING] if t.size else t
    v = run.speed.on(t) if t.size > 1 else np.empty(0)
    slow = np.flatnonzero(v < SLOWEST)
    n = int(slow[0]) if slow.size else v.size
    return (t[:n], v[:n]) if n * STEP >= SHORTEST else None


def _rate_at(t: Array, v: Array, speed: float, lag: float, noise: SpeedNoise) -> tuple[float, float]:
    """Deceleration [m/s^2] at a speed, and its standard error: v = (v0 + q) e^(-s/lag) - q, linear in both.

    The curve's shape is taken from the drive's lag; the rate in the middle hardly depends on it.
    """
    s = t - t[0]
    decay = np.exp(-s / lag)
    a = np.column_stack((decay, decay - 1.0))
    (v0, q), *_ = np.linalg.lstsq(a, v, rcond=None)
    weights = np.linalg.pinv(a)[1]  # of the samples in q
    variance = float(weights @ noise.covariance_times(weights, STEP))
    return float((speed + q) / lag), float(np.sqrt(variance) / lag)


def _zone_error(found: SpeedFit, rate: float, error: float, speed: float) -> float:
    """Standard error of the dead zone, offset - (T a - v) / K, from those of the fit and of the coasting."""
    model = found.model
    by_gain = (model.lag * rate - speed) / model.gain  # d/d log K
    by_lag = -model.lag * rate / model.gain  # d/d log T
    slope = np.array([by_gain, by_lag, 0.0, 1.0])
    return float(np.sqrt(slope @ found.covariance @ slope + (model.lag * error / model.gain) ** 2))
