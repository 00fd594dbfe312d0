"""What the vehicle really did and what the laptop really sent, written down by the world, not by the tool.

`Record.rows` has one `Row` a main loop (20 ms), `Record.sent` one `Sent` for each override that left the
laptop, `Record.texts` what the vehicle said (heard or not). Times are seconds of the world's clock.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, field
from itertools import pairwise
from math import hypot
from typing import NamedTuple

TRIM_US = 1500
_IN_TIME = 0.3
_DONE = re.compile(r"^SWP: run (\d+) done")
_STOPPED = re.compile(r"^SWP: run (\d+) stopped: (.*)")


class Row(NamedTuple):
    """One main loop. throttle: PWM output [us]; state, run: the applet's; heard: when the laptop last read a
    whole message of the vehicle, `-inf` for never; reachable: whether what the laptop sends now would come
    through, and it is awake and alive to send it."""

    t: float
    boot: int
    speed: float
    x: float
    y: float
    throttle: int
    armed: bool
    state: int
    run: int
    heard: float
    reachable: bool

    @property
    def driving(self) -> bool:
        """Throttle output above trim on an armed rover."""
        return self.armed and self.throttle > TRIM_US


class Sent(NamedTuple):
    """An override that left the laptop [us; 0xFFFF: channel left alone]. heard, state_heard: how long ago [s]
    the laptop had read anything, and SWP_ST."""

    t: float
    throttle: int
    switch: int
    heard: float
    state_heard: float

    @property
    def driving(self) -> bool:
        return TRIM_US < self.throttle < 0xFFFE

    @property
    def high(self) -> bool:
        return 1800 < self.switch < 0xFFFE


@dataclass
class Record:
    """See above. begun: (t, run) of each run that the applet began."""

    rows: list[Row] = field(default_factory=list)
    sent: list[Sent] = field(default_factory=list)
    texts: list[tuple[float, str]] = field(default_factory=list)
    begun: list[tuple[float, int]] = field(default_factory=list)

    @property
    def completed(self) -> tuple[int, ...]:
        """Runs that the applet itself called done."""
        return tuple(int(m[1]) for _, text in self.texts if (m := _DONE.match(text)))

    @property
    def stopped(self) -> dict[int, str]:
        """Why the applet stopped a run, by run."""
        return {int(m[1]): m[2] for _, text in self.texts if (m := _STOPPED.match(text))}

    @property
    def metres(self) -> float:
        """Way [m] with throttle above trim."""
        return sum(
            hypot(b.x - a.x, b.y - a.y) for a, b in pairwise(self.rows) if a.boot == b.boot and a.driving
        )

    def seconds(self, since: float = 0.0, until: float = float("inf")) -> float:
        """Time [s] with throttle above trim."""
        return sum(b.t - a.t for a, b in pairwise(self.rows) if since <= a.t < until and a.driving)

    def seconds_in(self, states: Collection[int]) -> float:
        """Time [s] with throttle above trim in these states of the applet."""
        return sum(b.t - a.t for a, b in pairwise(self.rows) if a.driving and a.state in states)

    def driven_unheard(self) -> float:
        """Longest time [s] since the laptop had heard the vehicle at which the rover still drove, although
        the laptop could have stopped it for the last `_IN_TIME` s."""
        longest, reachable_since = 0.0, 0.0
        for row in self.rows:
            reachable_since = reachable_since if row.reachable else row.t
            if row.driving and row.t - reachable_since > _IN_TIME:
                longest = max(longest, row.t - row.heard)
        return longest
