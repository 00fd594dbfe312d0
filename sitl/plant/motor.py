"""The motor controller: from a PWM to the speed that the drive would reach without resistance."""

from __future__ import annotations

from collections import deque
from math import copysign

from sitl.plant.variant import PlantParameters


class Motor:
    """Delay and dead zone; the lag is that of the force behind it (`axles.py`)."""

    __slots__ = ("_deadband", "_delay", "_lost", "_newest", "_now", "_pending", "_speed_per_us", "_trim")

    def __init__(self, parameters: PlantParameters) -> None:
        self._trim = parameters.throttle_trim_us
        self._deadband = parameters.throttle_deadband_us
        self._lost = parameters.throttle_lost_us
        self._speed_per_us = parameters.speed_per_us
        self._delay = parameters.throttle_delay
        self._pending: deque[tuple[float, float]] = deque()
        self._newest = self._now = 0.0

    def command(self, pwm_us: float, t: float) -> None:
        """The PWM [us] that holds from t [s] on; 0 us means no pulse."""
        if pwm_us != self._newest:
            self._newest = pwm_us
            self._pending.append((t + self._delay, pwm_us))

    def wanted_speed(self, t: float) -> float:
        """Speed [m/s] that the drive tends to at t [s]."""
        while self._pending and self._pending[0][0] <= t:
            self._now = self._pending.popleft()[1]
        offset = self._now - self._trim
        if self._now <= 0 or abs(offset) <= self._deadband or abs(offset) <= self._lost:
            return 0.0
        return (
            (offset - copysign(self._lost, offset)) * self._speed_per_us
            if self._lost
            else offset * self._speed_per_us
        )
