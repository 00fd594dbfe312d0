"""What lies between a commanded and a true road-wheel angle besides delay, lag and rate limit."""

from __future__ import annotations

from sitl.effects.table import Effects, number

IDS = frozenset(
    {
        "steering_backlash",
        "steering_deadband",
        "steering_nonlinearity",
        "steering_asymmetry",
        "steering_trim",
    }
)


class Linkage:
    """Static curve before the servo, dead zone of the servo's error, play behind it.

    The curve: u [rad] -> (1 +- e) u, then u (1 + c3 u2), then less u0. `deadband`: half width [rad].
    """

    __slots__ = ("_cubic", "_gap", "_left", "_played", "_right", "_trim", "deadband")

    def __init__(self, effects: Effects) -> None:
        self._cubic = number(effects, "steering_nonlinearity", "c3")
        uneven = number(effects, "steering_asymmetry", "e")
        self._left, self._right = 1.0 + uneven, 1.0 - uneven
        self._trim = number(effects, "steering_trim", "u0")
        self._gap = number(effects, "steering_backlash", "b")
        self.deadband = number(effects, "steering_deadband", "w")
        self._played = self.wanted(0.0)

    def wanted(self, u: float) -> float:
        """The angle [rad] that the servo is to reach for a commanded one."""
        u *= self._left if u > 0.0 else self._right
        return u * (1.0 + self._cubic * u * u) - self._trim

    def goal(self, target: float, angle: float) -> float:
        """Where a servo at `angle` stops on its way to `target`: as near as its dead zone lets it."""
        error = target - angle
        if abs(error) <= self.deadband:
            return angle
        return target - (self.deadband if error > 0.0 else -self.deadband)

    def played(self, servo: float) -> float:
        """Road-wheel angle [rad] after the servo moved, without turning back, to `servo`."""
        low, high = servo - self._gap, servo + self._gap
        self._played = low if self._played < low else high if self._played > high else self._played
        return self._played
