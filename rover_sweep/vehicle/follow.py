"""What the applet does, read from its messages while a run is driven."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from firmware_params.parameters import STATES
from rover_sweep.vehicle.events import Event, Said, Sample, StateChanged
from rover_sweep.vehicle.mavlink import Message, kind
from rover_sweep.vehicle.statustext import StatusText

_SAMPLE_EVERY = 0.1  # s of the vehicle's clock between two `Sample`s
_MILLI_G = 9.80665e-3
_DONE = re.compile(r"^SWP: run (\d+) done")
_REFUSED = "SWP: refused: "
_STOPPED = re.compile(r"^SWP: run (\d+) stopped:? *(.*)")
_STOPPED_STATE = 10
_LAST_STEERED = 8  # straight after: the manoeuvre itself is complete


@dataclass
class Follower:
    """Turns messages into events. steering: number of the steering servo output (1-based).

    state: the applet's now; active: it has left idle since `begin`; ended: it is idle or stopped
    again, at `ended_at` s of the vehicle's clock; refused: why it would not start; number: its run
    counter.
    """

    steering: int = 1
    state: int = 0
    number: int = 0
    active: bool = False
    ended: bool = False
    ended_at: float = 0.0
    refused: str = ""
    _highest: int = 0
    _told: tuple[bool, str] | None = None
    _events: deque[Event] = field(default_factory=deque)
    _frequency: float = 0.0
    _pwm: float = math.nan
    _r: float = math.nan
    _ay: float = math.nan
    _speed: float = math.nan
    _sampled: float = -math.inf

    def begin(self) -> None:
        """Forget what the applet did before; the switch is about to be thrown."""
        self.active = self.ended = False
        self._highest, self._told, self.refused = 0, None, ""

    def take(self) -> Iterator[Event]:
        """The events since the last call."""
        while self._events:
            yield self._events.popleft()

    @property
    def outcome(self) -> tuple[bool, str]:
        """(completed, reason in words): by the applet's words, else by the states it went through."""
        if self._told is not None:
            return self._told
        if self.ended and self.state != _STOPPED_STATE and self._highest >= _LAST_STEERED:
            return True, "the manoeuvre ran to its end"
        return False, "stopped by the applet" if self.ended else "the applet did not end in time"

    def message(self, message: Message, t: float) -> None:
        """Take a message that came at `t` s of the vehicle's clock."""
        name = kind(message)
        if name == "NAMED_VALUE_FLOAT":
            self._named(message.name, float(message.value), t)
        elif name == "SERVO_OUTPUT_RAW":
            self._pwm = float(getattr(message, f"servo{self.steering}_raw"))
        elif name == "ATTITUDE":
            self._r = -message.yawspeed
            self._sample(t)
        elif name == "RAW_IMU":
            self._ay = -message.yacc * _MILLI_G
        elif name == "LOCAL_POSITION_NED":
            self._speed = math.hypot(message.vx, message.vy)

    def text(self, text: StatusText) -> None:
        """Take a whole status text."""
        self._events.append(Said(text.t, text.severity, text.text))
        if text.text.startswith(_REFUSED):
            self.refused = text.text.removeprefix(_REFUSED)
        if match := _STOPPED.match(text.text):
            self.number, self._told = int(match[1]), (False, match[2] or "stopped by the applet")
        elif match := _DONE.match(text.text):
            self.number, self._told = int(match[1]), (True, "the manoeuvre ran to its end")

    def _named(self, name: str, value: float, t: float) -> None:
        if name == "SWP_W":
            self._frequency = value
        elif name == "SWP_RUN":
            self.number = int(value)
        elif name == "SWP_ST" and int(value) != self.state:
            self._enter(int(value), t)

    def _enter(self, state: int, t: float) -> None:
        self.state = state
        self._events.append(StateChanged(t, state, STATES.get(state, f"state {state}")))
        if 0 < state < _STOPPED_STATE:
            self.active, self._highest = True, max(self._highest, state)
        elif self.active or state == _STOPPED_STATE:
            self.active = self.ended = True
            self.ended_at = t

    def _sample(self, t: float) -> None:
        if t - self._sampled < _SAMPLE_EVERY:
            return
        self._sampled = t
        self._events.append(Sample(t, self.state, self._pwm, self._r, self._ay, self._speed, self._frequency))
