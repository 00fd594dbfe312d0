"""Steering effects in addition to delay, lag and rate limit: static curve, dead zone, stiction, play."""

from __future__ import annotations

from math import copysign, exp

from sitl.plant.effects_table import Effects, form, number

IDS = frozenset(
    {
        "steering_backlash",
        "steering_deadband",
        "steering_stiction",
        "steering_nonlinearity",
        "steering_asymmetry",
        "steering_trim",
    }
)
_ALIKE = 0.3  # rad, at which the cubic and the quadratic curve have the same gain


class Linkage:
    """Static curve and stiction before the servo, dead zone of its error or of the command, play behind it.

    The curve: u [rad] -> (1 +- e) u, or u + e u2/(0.3 rad), then u (1 + c3 u2), then less u0. `deadband`:
    half width [rad] of the servo's.
    """

    __slots__ = (
        "_before",
        "_command",
        "_cubic",
        "_even",
        "_full",
        "_gap",
        "_left",
        "_played",
        "_quadratic",
        "_right",
        "_smooth",
        "_stiction",
        "_trim",
        "_wound",
        "deadband",
    )

    def __init__(self, effects: Effects) -> None:
        c3 = number(effects, "steering_nonlinearity", "c3")
        quadratic = form(effects, "steering_nonlinearity") == "quadratic"
        self._cubic, self._quadratic = (0.0, _ALIKE * c3) if quadratic else (c3, 0.0)
        uneven = number(effects, "steering_asymmetry", "e")
        bent = form(effects, "steering_asymmetry") == "quadratic"
        self._left, self._right = (1.0, 1.0) if bent else (1.0 + uneven, 1.0 - uneven)
        self._even = uneven / _ALIKE if bent else 0.0
        self._trim = number(effects, "steering_trim", "u0")
        self._gap = number(effects, "steering_backlash", "b")
        self._smooth = self._gap > 0.0 and form(effects, "steering_backlash") == "smooth hysteresis"
        self._before = self._wound = 0.0
        stiction = number(effects, "steering_stiction", "s")
        follows = form(effects, "steering_stiction") == "with memory"
        self._stiction = _Stiction(stiction, follows) if stiction > 0.0 else None
        self._full = form(effects, "steering_deadband") == "full travel"
        width = number(effects, "steering_deadband", "w")
        of_command = effects.get("steering_deadband", {}).get("of") == "command"
        self._command, self.deadband = (width, 0.0) if of_command else (0.0, width)
        self._played = self._before = self.wanted(0.0)

    def wanted(self, u: float) -> float:
        """Target angle [rad] of the servo for a commanded angle [rad]."""
        if self._command > 0.0 and (not self._full or abs(u) < self._command):
            u -= min(max(u, -self._command), self._command)
        if self._stiction is not None:
            u = self._stiction.held(u)
        u = u * (self._left if u > 0.0 else self._right) + self._even * u * u
        return u * (1.0 + self._cubic * u * u + self._quadratic * abs(u)) - self._trim

    def goal(self, target: float, angle: float) -> float:
        """Angle [rad] at which a servo at `angle` stops before `target`: at the edge of its dead zone."""
        error = target - angle
        if abs(error) <= self.deadband:
            return angle
        return target - (self.deadband if error > 0.0 else -self.deadband)

    def played(self, servo: float) -> float:
        """Road-wheel angle [rad] after the servo moved, without turning back, to `servo`."""
        if self._smooth:
            return self._hysteresis(servo)
        low, high = servo - self._gap, servo + self._gap
        self._played = low if self._played < low else high if self._played > high else self._played
        return self._played

    def _hysteresis(self, servo: float) -> float:
        """Bouc-Wen with n = 1, wound = z: solved for a servo that moved without turning back."""
        moved, self._before = servo - self._before, servo
        if moved != 0.0:
            way = copysign(1.0, moved)
            self._wound = way + (self._wound - way) * exp(-abs(moved) / self._gap)
        return servo - self._gap * self._wound


class _Stiction:
    """Angles [rad] that are held until the command is more than `most` away.

    follows: the angle then goes with the command until that turns back, else it goes there once.
    """

    __slots__ = ("_angle", "_follows", "_last", "_most", "_way")

    def __init__(self, most: float, follows: bool) -> None:
        self._most, self._follows = most, follows
        self._angle = self._last = self._way = 0.0

    def held(self, u: float) -> float:
        """The angle after the next command."""
        if (u - self._last) * self._way < 0.0:
            self._way = 0.0
        self._last = u
        if self._way != 0.0 or abs(u - self._angle) > self._most:
            if self._follows and self._way == 0.0:
                self._way = copysign(1.0, u - self._angle)
            self._angle = u
        return self._angle
