"""The numbers of an identified speed response by name, with 90 % intervals: law, drag and dead zone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rover_sweep.data.by_name import ByName
from rover_sweep.data.plain_values import PlainNumbers
from rover_sweep.identification.speed.identify_speed import SpeedResult
from rover_sweep.identification.speed.speed_fit import NORMAL_90, SpeedFit

SHARE = "of full throttle"


@dataclass(frozen=True)
class SpeedParameter(PlainNumbers):
    """A number of the speed's law: value and 90 % interval (low, high) in `unit`, meaning in words."""

    name: str
    value: float
    unit: str
    interval_90: tuple[float, float]
    meaning: str


def speed_parameters(result: SpeedResult) -> ByName[SpeedParameter]:
    """gain, lag, delay, offset and drag; with a coasting also coasting_drag and, if certain, dead_zone.

    Empty for a result without a law.
    """
    if result.fit is None:
        return ByName()
    model, ends, mean = result.fit.model, result.fit.intervals, result.speeds[1]
    drag, drag_ends = driving_drag(result.fit, mean)
    found = [
        SpeedParameter(
            "gain", model.gain, "m/s per full throttle", ends["gain"], "steady speed per throttle"
        ),
        SpeedParameter("lag", model.lag, "s", ends["lag"], "time constant of the speed"),
        SpeedParameter("delay", model.delay, "s", ends["delay"], "dead time, with that of the EKF's speed"),
        SpeedParameter(
            "offset", model.offset, SHARE, ends["offset"], "throttle before it moves: dead zone and drag"
        ),
        SpeedParameter("drag", drag, "m/s^2", drag_ends, f"of drive and road at {mean:.2f} m/s, driving"),
    ]
    if (rolled := result.coasting) is not None:
        words = f"slowing at {rolled.speed:.2f} m/s, throttle at neutral"
        found.append(SpeedParameter("coasting_drag", rolled.deceleration, "m/s^2", rolled.interval, words))
        if rolled.dead_zone is not None and rolled.dead_zone_interval is not None:
            zone, low, high = (max(v, 0.0) for v in (rolled.dead_zone, *rolled.dead_zone_interval))
            words = "dead zone of the motor controller"
            found.append(SpeedParameter("dead_zone", zone, SHARE, (low, high), words))
    return ByName(found)


def driving_drag(fit: SpeedFit, speed: float) -> tuple[float, tuple[float, float]]:
    """(v + K u0) / T [m/s^2]: deceleration by drive and road while it drives at a speed [m/s]; 90 % interval.

    With the dead zone in u0, so it is the most that the drag can be.
    """
    m = fit.model
    value = (speed + m.gain * m.offset) / m.lag
    slope = np.array([m.gain * m.offset / m.lag, -value, 0.0, m.gain / m.lag])  # log K, log T, delay, u0
    spread = NORMAL_90 * float(np.sqrt(slope @ fit.covariance @ slope))
    return value, (value - spread, value + spread)
