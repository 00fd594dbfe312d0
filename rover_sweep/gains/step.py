"""Predicted responses of the loop: to a step of the target turn rate, and to a disturbance of the wheels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.gains.controller import SimulatedDrive, simulate_loop
from rover_sweep.gains.steering_chain import Autopilot, Gains
from rover_sweep.gains.steering_plant import SampledPlant

SECONDS = 4.0
BEFORE = 0.2  # s of straight driving before a step
SETTLED = 0.05  # of the step
PUSH = 0.02  # rad, disturbance of the road-wheel angle, as by a trim error of 1 deg
LARGEST_SHARE = 0.5  # of the turn rate that steering and limits allow


@dataclass(frozen=True)
class Step:
    """size [rad/s] of the target; rise [s]: time from 10 to 90 %; overshoot [% of size]; settling [s]: time
    from the request until it stays within 5 % of the size; nan if not reached. lag [s]: integral of (limited
    target - rate) / size; used: largest share of the steering's travel."""

    size: float
    rise: float
    overshoot: float
    settling: float
    lag: float
    used: float


def step_size(autopilot: Autopilot, plant: SampledPlant, angle_per_output: float) -> float:
    """Half of the turn rate [rad/s] that steering and limits allow at this speed, at most 0.6."""
    reach = abs(plant.gain * angle_per_output)
    return min(LARGEST_SHARE * min(reach, autopilot.rate_limit(plant.speed)), 0.6)


def step_target(autopilot: Autopilot, size: float) -> Array:
    """The requested turn rate (m,) [rad/s] of a step after `BEFORE` s, one value per main loop."""
    t = np.arange(round(SECONDS / autopilot.period)) * autopilot.period
    return np.where(t >= BEFORE, size, 0.0)


def step_of(autopilot: Autopilot, plant: SampledPlant, angle_per_output: float, gains: Gains) -> Step:
    """The predicted step response with all limits of the firmware."""
    size = step_size(autopilot, plant, angle_per_output)
    driven = simulated_step(autopilot, plant, angle_per_output, gains, size)
    return step_metrics(
        driven.t - BEFORE, driven.target, driven.rate[:, 0], size, float(np.abs(driven.steering).max())
    )


def simulated_step(
    autopilot: Autopilot, plant: SampledPlant, angle_per_output: float, gains: Gains, size: float
) -> SimulatedDrive:
    """The simulated step."""
    p, i, ff = (np.array([g]) for g in (gains.p, gains.i, gains.ff))
    return simulate_loop(autopilot, plant, angle_per_output, step_target(autopilot, size), p, i, ff, gains)


def step_metrics(t: Array, target: Array, rate: Array, size: float, used: float = math.nan) -> Step:
    """The Step of a recorded or simulated step from 0 to size; t (m,) [s] since the request."""
    share = rate / size
    after = t >= 0
    outside = np.flatnonzero(np.abs(share - 1.0) > SETTLED)
    last = int(outside[-1]) if outside.size else 0
    settling = float(t[last + 1]) if last + 1 < t.size else math.nan
    behind = float(np.sum((target - rate)[after]) / size * np.mean(np.diff(t)))
    return Step(
        size,
        _first(t, share, 0.9) - _first(t, share, 0.1),
        100 * max(float(share.max()) - 1.0, 0.0),
        settling,
        behind,
        used,
    )


def _first(t: Array, share: Array, level: float) -> float:
    """The interpolated time [s] at which the share first passes a level; nan if never."""
    above = np.flatnonzero((share[1:] >= level) & (share[:-1] < level))
    if above.size == 0:
        return math.nan
    k = int(above[0])
    return float(t[k] + (level - share[k]) / (share[k + 1] - share[k]) * (t[k + 1] - t[k]))


def disturbance_error(
    autopilot: Autopilot, plant: SampledPlant, angle_per_output: float, p: Array, i: Array, shared: Gains
) -> Array:
    """Integral of abs(error) (n,) [rad] over SECONDS after a disturbance of the wheels by PUSH."""
    still = np.zeros(round(SECONDS / autopilot.period))
    push = np.full(still.size, PUSH)
    driven = simulate_loop(autopilot, plant, angle_per_output, still, p, i, np.zeros_like(p), shared, push)
    return np.asarray(np.abs(driven.rate).sum(axis=0) * autopilot.period)
