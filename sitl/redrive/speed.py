"""A throttle that makes a simulated rover follow a recorded speed."""

from __future__ import annotations

from sitl.plant.variant import PlantParameters

FOLLOW_S = 0.1  # time in which a difference is made up for
INTEGRAL_S = 0.4  # and what resistance leaves of it
STANDING = 0.15  # m/s, below which the recorded rover stood


class SpeedFollower:
    """Throttle [us] from the wanted and the present speed [m/s], once a main loop of `period` [s].

    It knows what the motor controller makes of a PWM (speed_per_us, speed_lag), so that the demand for an
    acceleration can be turned into one; resistance is found by the integral.
    """

    def __init__(self, parameters: PlantParameters, period: float) -> None:
        self._parameters = parameters
        self.period = period
        self._integral = 0.0

    def throttle(self, wanted: float, rate: float, speed: float) -> float:
        """For a wanted speed and its rate of change [m/s2]; the trim for a rover at rest."""
        q = self._parameters
        if abs(wanted) < STANDING:
            self._integral = 0.0
            return q.throttle_trim_us
        error = wanted - speed
        limit = q.drive_force_limit / q.mass
        demand = rate + error / FOLLOW_S + self._integral
        if abs(demand) < limit:
            self._integral += error * self.period / (FOLLOW_S * INTEGRAL_S)
        return q.throttle_trim_us + (speed + q.speed_lag * demand) / q.speed_per_us
