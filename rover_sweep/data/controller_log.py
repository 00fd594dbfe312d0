"""The log of one of the firmware's controllers while driving: target, response and terms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from rover_sweep.data.recording import Array, Mask

STALE_S = 0.1  # s; an unchanged measurement for longer shows that the controller did not run
PAUSE = 0.5  # s between two rows after which the controller counts as stopped
LEAST_SECONDS = 5.0  # s of driving that one set of parameters needs to be checked


@dataclass(frozen=True, eq=False)
class ControllerLog:
    """The steering rate controller (rad/s, positive right) or the speed controller (m/s), as logged.

    t (n,) [s], strictly increasing; target, actual (n,); p, i, d, ff (n,): the terms of the output, -1..1 of
    full steering or throttle; ff includes the derivative feed-forward, and for the speed the base throttle.
    speed (n,): forward speed [m/s], negative in reverse. parameters: by name, constant during the log. Only
    rows in which the controller ran, without MANUAL or HOLD. mode (n,): number of the vehicle's mode, empty
    where it was not logged.
    """

    name: str
    t: Array
    target: Array
    actual: Array
    p: Array
    i: Array
    d: Array
    ff: Array
    speed: Array
    parameters: Mapping[str, float]
    mode: Array = field(default_factory=lambda: np.empty(0))

    @cached_property
    def output(self) -> Array:
        """The sum of the terms (n,), before limits and before the firmware's scaling with speed."""
        return self.p + self.i + self.d + self.ff

    @property
    def reverse(self) -> bool:
        """Whether the rover drove backwards."""
        return bool(self.speed.size) and float(np.median(self.speed)) < 0

    @property
    def seconds(self) -> float:
        """Time [s] in which the controller ran."""
        steps = np.diff(self.t)
        return float(steps[steps < PAUSE].sum())

    def where(self, keep: Mask) -> ControllerLog:
        """The rows of a mask (n,)."""
        columns = ["t", "target", "actual", "p", "i", "d", "ff", "speed"]
        columns += ["mode"] if self.mode.size else []
        return replace(self, **{name: getattr(self, name)[keep] for name in columns})

    def running(self) -> ControllerLog:
        """Without the rows in which the controller did not run: they repeat its last measurement."""
        changed = np.ones(self.t.size, dtype=bool)
        changed[1:] = np.diff(self.actual) != 0
        last = np.maximum.accumulate(np.where(changed, np.arange(self.t.size), 0))
        return self.where(self.t - self.t[last] <= STALE_S) if self.t.size else self

    def stretches(self, changes: Sequence[tuple[float, str, float]]) -> Iterator[ControllerLog]:
        """The log in parts with constant parameters, forward and in reverse apart.

        changes: (time [s], name, value) in their order. Parts of less than `LEAST_SECONDS` are left out.
        """
        if not self.t.size:
            return
        known = dict(self.parameters)
        edges = [(-np.inf, known)]
        for at, name, value in changes:
            before = known.get(name, value)
            if before != value and name.startswith(TUNED):
                known = dict(known)
                edges.append((at, known))
            known[name] = value
        ends = [*(at for at, _ in edges[1:]), np.inf]
        for (start, parameters), end in zip(edges, ends, strict=True):
            inside = (self.t >= start) & (self.t < end)
            for way in (inside & (self.speed >= 0), inside & (self.speed < 0)):
                part = self.where(way)
                if part.seconds >= LEAST_SECONDS:
                    yield replace(part, parameters=parameters)


TUNED = ("ATC_STR_", "ATC_TURN_", "ATC_SPEED_", "ATC_ACCEL", "ATC_DECEL", "CRUISE_", "MOT_", "INS_GYRO_")
