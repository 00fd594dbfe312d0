"""Steering effects in addition to delay, lag and rate limit: static curve, dead zone, play."""

from __future__ import annotations

from sitl.plant.effects_table import Effects, number

IDS = frozenset(
    {"steering_backlash", "steering_deadband", "steering_nonlinearity", "steering_asymmetry", "steering_trim"}
)


class Linkage:
    """Static curve before the servo, dead zone of the servo's error or of the command, play behind it.

    The curve: u [rad] -> (1 +- e) u, then u (1 + c3 u2), then less u0. `deadband`: half width [rad] of the
    servo's.
    """

    __slots__ = ("_command", "_cubic", "_gap", "_left", "_played", "_right", "_trim", "deadband")

    def __init__(self, effects: Effects) -> None:
        self._cubic = number(effects, "steering_nonlinearity", "c3")
        uneven = number(effects, "steering_asymmetry", "e")
        self._left, self._right = 1.0 + uneven, 1.0 - uneven
        self._trim = number(effects, "steering_trim", "u0")
        self._gap = number(effects, "steering_backlash", "b")
        width = number(effects, "steering_deadband", "w")
        of_command = effects.get("steering_deadband", {}).get("of") == "command"
        self._command, self.deadband = (width, 0.0) if of_command else (0.0, width)
        self._played = self.wanted(0.0)

    def wanted(self, u: float) -> float:
        """Target angle [rad] of the servo for a commanded angle [rad]."""
        if self._command > 0.0:
            u -= min(max(u, -self._command), self._command)
        u *= self._left if u > 0.0 else self._right
        return u * (1.0 + self._cubic * u * u) - self._trim

    def goal(self, target: float, angle: float) -> float:
        """Angle [rad] at which a servo at `angle` stops before `target`: at the edge of its dead zone."""
        error = target - angle
        if abs(error) <= self.deadband:
            return angle
        return target - (self.deadband if error > 0.0 else -self.deadband)

    def played(self, servo: float) -> float:
        """Road-wheel angle [rad] after the servo moved, without turning back, to `servo`."""
        low, high = servo - self._gap, servo + self._gap
        self._played = low if self._played < low else high if self._played > high else self._played
        return self._played
