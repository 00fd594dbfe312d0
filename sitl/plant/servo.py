"""The steering servo and its linkage: from a PWM that is held between main loops to a road-wheel angle."""

from __future__ import annotations

from collections import deque
from math import exp

from sitl.plant.effects.steering_effects import IDS, Linkage
from sitl.plant.variant import PlantParameters


class Servo:
    """Delay, first-order lag with a rate limit, end stops; solved exactly for any step.

    `angle` is the road-wheel angle [rad], left positive, 0 at the trim. What a variant's effects put before
    and behind the servo is in `sitl.plant.effects.steering_effects`.
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
        if self._target != self._servo:
            self._move(end - t)
        return self.angle

    def _move(self, dt: float) -> None:
        linkage, target = self._linkage, self._target
        if linkage is not None:
            target = linkage.goal(target, self._servo)
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
