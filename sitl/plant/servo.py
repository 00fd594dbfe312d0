"""The steering servo and its linkage: from a PWM that is held between main loops to a road-wheel angle."""

from __future__ import annotations

from collections import deque
from math import ceil, exp, sqrt

from sitl.plant.effects.steering_effects import IDS, Linkage
from sitl.plant.effects_table import number
from sitl.plant.variant import PlantParameters

_SHARE = 0.02  # largest step of a swinging servo in 1/w0


class Servo:
    """Delay, first-order lag with a rate limit, end stops; solved exactly for any step.

    `angle` is the road-wheel angle [rad], left positive, 0 at the trim. What a variant's effects put before
    and behind the servo is in `Linkage`.
    """

    __slots__ = (
        "_lag",
        "_limit",
        "_linkage",
        "_newest",
        "_pending",
        "_rad_per_us",
        "_rate",
        "_delay",
        "_servo",
        "_shape",
        "_speed",
        "_target",
        "_trim",
        "angle",
    )

    def __init__(self, parameters: PlantParameters) -> None:
        self._trim = parameters.steering_trim_us
        self._rad_per_us = parameters.rad_per_us
        self._limit = parameters.steering_limit
        self._lag = parameters.servo_lag
        self._rate = parameters.servo_rate_limit
        self._delay = parameters.servo_delay
        self._pending: deque[tuple[float, float]] = deque()
        self._newest = self._trim
        effects = parameters.effects
        self._shape = number(effects, "servo_lag", "q")
        self._speed = 0.0  # rad/s, of a servo of second order
        self._linkage = Linkage(effects) if IDS & effects.keys() else None
        self._target = self._servo = self.angle = self._linkage.wanted(0.0) if self._linkage else 0.0

    def command(self, pwm_us: float, t: float) -> None:
        """A PWM [us] on the wire from time t [s]. Without pulse (0) the servo keeps its last target."""
        if pwm_us != self._newest and pwm_us > 0:
            self._newest = pwm_us
            wanted = -(pwm_us - self._trim) * self._rad_per_us
            if self._linkage is not None:
                wanted = self._linkage.wanted(wanted)
            limited = min(max(wanted, -self._limit), self._limit)
            self._pending.append((t + self._delay, limited))

    def advance(self, t: float, end: float) -> float:
        """Move from time t to `end` [s], through every delayed command that comes due; returns the angle."""
        pending = self._pending
        while pending and pending[0][0] < end:
            due, target = pending.popleft()
            if due > t:
                self._move(due - t)
                t = due
            self._target = target
        if self._target != self._servo or self._speed != 0.0:
            self._move(end - t)
        return self.angle

    def _move(self, dt: float) -> None:
        linkage, target = self._linkage, self._target
        if linkage is not None:
            target = linkage.goal(target, self._servo)
        if self._shape > 0.0 and self._lag > 0.0:
            self._swing(target, dt)
            return
        error = target - self._servo
        knee = self._rate * self._lag
        size = abs(error)
        if size > knee:  # the lag would ask for more than the rate limit
            slewing = min(dt, (size - knee) / self._rate)
            size -= slewing * self._rate
            dt -= slewing
        if dt > 0:
            size = size * exp(-dt / self._lag) if self._lag > 0 else 0.0
        self._servo = target - (size if error > 0 else -size)
        self.angle = self._servo if linkage is None else linkage.played(self._servo)

    def _swing(self, target: float, dt: float) -> None:
        """q T^2 d'' + T d' + d = target with a limited rate, by leapfrog steps."""
        inertia = self._shape * self._lag * self._lag
        steps = ceil(dt / (_SHARE * min(sqrt(inertia), self._shape * self._lag)))
        h = dt / steps
        keep = exp(-h * self._lag / inertia)
        x, w, most = self._servo, self._speed, self._rate
        for _ in range(steps):
            x += 0.5 * h * w
            rest = (target - x) / self._lag  # rad/s, at which the damping balances the spring
            w = min(max(rest + (w - rest) * keep, -most), most)
            x += 0.5 * h * w
            self.angle = x if self._linkage is None else self._linkage.played(x)
        if abs(target - x) < 1e-12 and abs(w) < 1e-9:
            x, w = target, 0.0
        self._servo, self._speed = x, w
