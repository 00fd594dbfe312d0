"""Excitation of any shape: driving in which the steering's spectrum carries enough to identify from.

A step, a sine, or a trial of two seconds has no shape that repeats. It is excitation where the steering,
without its mean and drift, moves by more than the smallest steering. Whether the trials together cover a band
is judged from their coherence (`quality.coherence`).
"""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Signal
from rover_sweep.logs.log import Array, Log
from rover_sweep.logs.runs.wave import HALT, MOVING_SPEED, SHORTEST_RUN, active_threshold

SHORTEST_TRIAL = 1.5  # s
WHOLE = 0.6  # of the trial
SLOW_SHARE = 0.5  # of the usual speed of a drive, where that is low: above it the rover moves
STEP = 0.02  # s, grid of the steering
CARRIED = 0.3  # of the smallest steering: rms of the steering without mean and drift


def carried_intervals(log: Log) -> list[tuple[float, float]]:
    """Intervals (start, end) [s] of driving without a halt whose steering carries, whatever its shape.

    Shorter ones than `SHORTEST_RUN` count only as a whole trial: in a long drive they are manoeuvring.
    """
    speed, steering = log.signals["speed"], log.steering[0]
    least = min(SHORTEST_RUN, WHOLE * float(steering.t[-1] - steering.t[0])) if steering.t.size else 0.0
    long = [(a, b) for a, b in _driven(speed, steering) if b - a >= least]
    return [(a, b) for a, b in long if carries(steering.between(a, b), a, b)]


def carries(steering: Signal, start: float, end: float) -> bool:
    """True when the steering in start..end [s], without mean and drift, is more than a receiver's noise."""
    grid = np.arange(start, end, STEP)
    if grid.size < SHORTEST_TRIAL / STEP or steering.t.size < 2:
        return False
    x = steering.on(grid)
    rest = x - np.polyval(np.polyfit(grid - start, x, 1), grid - start)
    threshold = active_threshold(steering)
    return bool(np.ptp(x) > threshold and np.sqrt(np.mean(rest**2)) > CARRIED * threshold)


def _driven(speed: Signal, steering: Signal) -> list[tuple[float, float]]:
    """Intervals (start, end) [s] in which the rover moves, apart by halts of at least `HALT`."""
    forward = speed.x[speed.x > 0]
    usual = float(np.percentile(forward, 75)) if forward.size else 0.0
    moving = speed.t[speed.x > min(MOVING_SPEED, SLOW_SHARE * usual)]
    times: Array = moving[(moving >= steering.t[0]) & (moving <= steering.t[-1])]
    if times.size < 2:
        return []
    cuts = np.flatnonzero(np.diff(times) > HALT) + 1
    parts = [(float(part[0]), float(part[-1])) for part in np.split(times, cuts)]
    return [(a, b) for a, b in parts if b - a >= SHORTEST_TRIAL]
