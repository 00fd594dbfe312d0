"""The path round a 90 degree corner at constant speed, with the loop and its limits.

The turn begins before the corner so that the rover ends on the next leg. The request is that of the
firmware's heading controller (`AR_AttitudeControl.cpp` get_turn_rate_from_heading): ATC_STR_ANG_P times the
error of the heading, at most what ATC_STR_ACC_MAX can stop in time. The S-curves of AUTO plan with
ATC_TURN_MAX_G alone, so with a lower ATC_STR_RAT_MAX or ATC_STR_ACC_MAX the rover swings wide
(https://github.com/ArduPilot/ardupilot/issues/32917). Sideslip is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.gains.controller import simulate_loop
from rover_sweep.gains.proposal import Proposal, SteeringLimits, family_of
from rover_sweep.gains.steering_chain import Autopilot, Gains, SampledPlant
from rover_sweep.gains.tuning import speeds_around

CORNER = math.pi / 2
HALF_WIDTH = 1.0  # m, of the corridor about both legs
AFTER = 6.0  # s, beyond twice the time at the largest turn rate


@dataclass(frozen=True)
class Corner:
    """A corner at a speed [m/s]. gains: "now" or "proposed". rate [rad/s]: largest turn rate; before [m]:
    distance from the start of the turn to the corner; a turn begun at the corner swings wide by it. off [m]:
    largest distance from the nearer leg. leaves, returns [m]: where it leaves the corridor and where it is
    back, along the legs, negative before the corner; None inside. wide: on the outside of the corner."""

    speed: float
    gains: str
    rate: float
    before: float
    off: float
    leaves: float | None = None
    returns: float | None = None
    wide: bool = False


def corners(
    proposal: Proposal, limits: SteeringLimits | None, half_width: float = HALF_WIDTH
) -> tuple[Corner, ...]:
    """Corners at the speeds for which the gains hold, slow first, for the current and proposed gains and
    limits. half_width [m]: of the corridor."""
    found, loop = proposal.found, proposal.autopilot
    if proposal.now is None or found.structure is None:
        return ()
    sets = [("now", proposal.now.gains, loop)]
    if proposal.proposed is not None:
        sets.append(("proposed", proposal.proposed.gains, _with_limits(loop, limits)))
    out = []
    for speed in sorted(speeds_around(proposal.speed)):
        family = family_of(replace(found, intervals={}), loop, speed)
        for name, gains, limited in sets:
            path = corner_path(limited, family.nominal, family.angle_per_output[0], gains)
            out.append(_judged(speed, name, *path, half_width))
    return tuple(out)


def _with_limits(loop: Autopilot, limits: SteeringLimits | None) -> Autopilot:
    if limits is None:
        return loop
    force = loop.lateral_g_max if limits.turn_g is None or limits.lowers else limits.turn_g
    return replace(loop, rate_max=math.radians(limits.rate_max), lateral_g_max=force)


def corner_path(
    loop: Autopilot, plant: SampledPlant, angle_per_output: float, gains: Gains
) -> tuple[float, Array, Array]:
    """(largest turn rate [rad/s], ahead (n,), aside (n,) [m]) from the start of the turn."""
    seconds = 2 * CORNER / loop.rate_limit(plant.speed) + AFTER
    still = np.zeros(round(seconds / loop.period))
    p, i, ff = (np.array([g]) for g in (gains.p, gains.i, gains.ff))
    outer = _heading_controller(loop)
    drive = simulate_loop(loop, plant, angle_per_output, still, p, i, ff, gains, outer=outer)
    rate = drive.rate[:, 0]
    heading = np.cumsum(rate) * loop.period
    step = plant.speed * loop.period
    ahead, aside = np.cumsum(np.cos(heading)) * step, np.cumsum(np.sin(heading)) * step
    seen_late = math.sqrt(2) / (2 * math.pi * loop.gyro_hz) if loop.gyro_hz > 0 else 0.0
    return float(np.abs(rate).max()), ahead - plant.speed * seen_late, aside


def _heading_controller(loop: Autopilot) -> Callable[[float], float]:
    """The requested turn rate [rad/s] for the measured one, main loop by main loop."""
    left = CORNER

    def request(rate: float) -> float:
        nonlocal left
        left -= rate * loop.period
        most = math.sqrt(2 * abs(left) * loop.accel_max) if loop.accel_max > 0 else math.inf
        return min(max(loop.angle_p * left, -most), most)

    return request


def _judged(speed: float, name: str, rate: float, ahead: Array, aside: Array, half_width: float) -> Corner:
    before = float(ahead[-1])
    off = np.minimum(np.abs(aside), np.abs(before - ahead))
    outside = np.flatnonzero(off > half_width)
    if not outside.size:
        return Corner(speed, name, rate, before, float(off.max()))
    along = np.where(np.abs(aside) < np.abs(before - ahead), ahead - before, aside)
    leaves, returns = float(along[outside[0]]), float(along[outside[-1]])
    wide = bool(ahead[np.argmax(off)] > before)
    return Corner(speed, name, rate, before, float(off.max()), leaves, returns, wide)
