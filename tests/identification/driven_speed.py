"""Throttle sweeps of a simple rover by small Euler steps, independent of the identification's own
simulation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Signal, ThrottleRun

PARAMETERS = {"SERVO3_FUNCTION": 70.0, "SERVO3_TRIM": 1500.0, "SERVO3_MIN": 1100.0, "SERVO3_MAX": 1900.0}


@dataclass(frozen=True)
class Truth:
    """gain [m/s per full throttle]; lag, delay [s]; dead_zone and drag: shares of full throttle."""

    gain: float = 5.0
    lag: float = 0.7
    delay: float = 0.12
    dead_zone: float = 0.06
    drag: float = 0.03


def driven(
    truth: Truth | None = None,
    amplitude: float = 60.0,
    noise: float = 0.02,
    seed: int = 1,
    held: float = 1730.0,
    other: float = 0.0,
) -> ThrottleRun:
    """A sweep of 60 s and the coasting after it; noise, other: [m/s rms] of the measured speed and of a speed
    that the throttle did not cause, correlated over 1.6 s."""
    q, dt = truth or Truth(), 0.005
    t = np.arange(0.0, 75.0, dt)
    s = np.clip(t - 5.0, 0.0, 55.0)
    phase = 0.2 * s + 0.0187 * 7.8 * (55 / 4 * np.expm1(4 * s / 55) - s)
    pwm = held + amplitude * np.sin(phase) * ((t > 5) & (t < 60))
    pwm = np.where(t < 62.0, np.floor(pwm + 0.5), 1500.0)
    u = (np.interp(t - q.delay, t, pwm) - 1500) / 400
    pulled = np.maximum(np.abs(u) - q.dead_zone, 0.0) - q.drag
    v = np.empty(t.size)
    v[0] = q.gain * pulled[0]
    for k in range(t.size - 1):
        v[k + 1] = max(v[k] + dt * (q.gain * pulled[k] - v[k]) / q.lag, 0.0)
    random = np.random.default_rng(seed)
    share = np.exp(-dt / 1.6)
    white = random.standard_normal(t.size) * np.sqrt(1 - share**2)
    drift = np.empty(t.size)
    drift[0] = random.standard_normal()
    for k in range(t.size - 1):
        drift[k + 1] = share * drift[k] + white[k]
    speed = v + (noise + other) * drift
    return ThrottleRun(
        "run",
        Signal(t[::2], pwm[::2], "us", hold=True),
        Signal(t[::2], speed[::2], "m/s"),
        (2.0, 62.0),
        (0.2, 8.0),
        PARAMETERS,
    )
