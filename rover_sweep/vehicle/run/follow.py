"""Follows the applet by its messages while a run is driven."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from firmware_params.applet_parameters import STATES
from rover_sweep.data.geometry import MILLI_G
from rover_sweep.vehicle.events import Event, Sample, StateChanged
from rover_sweep.vehicle.link.connection import VehicleClock
from rover_sweep.vehicle.link.mavlink import Message, kind
from rover_sweep.vehicle.link.statustext import Said

_SAMPLE_EVERY = 0.1  # s of the vehicle's clock between two `Sample`s
_REFUSED = "SWP: refused: "
_OVER = re.compile(r"^SWP: run (\d+) (?:done|stopped:? *(.*))")
STOPPED_STATE = 10
COMPLETED = "the manoeuvre ran to its end"
STOPPED_BY_APPLET = "stopped by the applet"


def outcome_told(text: str) -> tuple[int, bool, str] | None:
    """(run counter, completed, reason) by the applet's text at the end of a run; None for any other text."""
    if (match := _OVER.match(text)) is None:
        return None
    completed = match[2] is None
    return int(match[1]), completed, COMPLETED if completed else match[2] or STOPPED_BY_APPLET


class ParameterWatch:
    """Parameters that somebody else sets while a run is driven. known: {name: value} before it.

    ArduPilot sends PARAM_VALUE on every link when a parameter is set.
    """

    def __init__(self, known: Mapping[str, float]) -> None:
        self._known, self._changed = dict(known), dict[str, float]()

    def message(self, message: Message) -> None:
        """Take a message of the vehicle."""
        if kind(message) != "PARAM_VALUE" or message.param_id not in self._known:
            return
        value = float(message.param_value)
        if math.isclose(value, self._known[message.param_id], rel_tol=1e-5, abs_tol=1e-9):
            self._changed.pop(message.param_id, None)
        else:
            self._changed[message.param_id] = value

    @property
    def sentence(self) -> str:
        """What was changed and what to do, '' for nothing."""
        told = [
            f"{name} from {self._known[name]:.7g} to {value:.7g}" for name, value in self._changed.items()
        ]
        if not told:
            return ""
        return (
            f"somebody else changed {', '.join(told)} during the run: a run is identified with one value of "
            "each parameter, so drive it again"
        )


@dataclass
class Follower:
    """Turns messages into events. steering: number of the steering servo output (1-based).

    state: of the applet; reports: the applet has reported its state; active: it has left idle since `begin`;
    ended: it is idle or stopped again, at `ended_at` on the vehicle's clock [s]; refused: why it did not
    start; number: its run counter; speed [m/s], NaN if unknown.
    """

    steering: int = 1
    state: int = 0
    number: int = 0
    active: bool = False
    ended: bool = False
    ended_at: float = 0.0
    refused: str = ""
    reports: bool = False
    speed: float = math.nan
    _followed: bool = False
    _before: int = 0
    _whole: int = 0
    _ends: dict[int, tuple[bool, str]] = field(default_factory=dict)
    _events: deque[Event] = field(default_factory=deque)
    _frequency: float = 0.0
    _pwm: float = math.nan
    _r: float = math.nan
    _ay: float = math.nan
    _sampled: float = -math.inf

    def begin(self) -> None:
        """Forget the previous run; the switch is about to be thrown."""
        self.active = self.ended = False
        self._followed, self._before = True, self.number
        self._ends, self.refused = {}, ""

    def take(self) -> Iterator[Event]:
        """The events since the last call."""
        while self._events:
            yield self._events.popleft()

    @property
    def _begun(self) -> bool:
        return self.number != self._before

    @property
    def outcome_heard(self) -> bool:
        """Whether the applet reported how the run ended."""
        return self._begun and (self.number in self._ends or self._whole == self.number)

    @property
    def outcome(self) -> tuple[bool, str]:
        """(completed, reason) of the run that was started: by the applet's texts, else by SWP_DONE."""
        if not self._begun:
            return False, "the applet started no run"
        if self.number in self._ends:
            return self._ends[self.number]
        if self._whole == self.number:
            return True, COMPLETED
        return (
            False,
            "it ended early, its reason was lost" if self.ended else "the applet did not end in time",
        )

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
            self._ay = -message.yacc * MILLI_G
        elif name == "LOCAL_POSITION_NED":
            self.speed = math.hypot(message.vx, message.vy)

    def text(self, text: Said) -> None:
        """Take a whole status text."""
        self._events.append(text)
        if text.text.startswith(_REFUSED):
            self.refused = text.text.removeprefix(_REFUSED)
        if told := outcome_told(text.text):
            self._ends[told[0]] = told[1:]

    def _named(self, name: str, value: float, t: float) -> None:
        if name == "SWP_W":
            self._frequency = value
        elif name == "SWP_RUN":
            if not (self._followed and self._begun):  # a later run is not followed
                self.number = int(value)
        elif name == "SWP_DONE":
            self._whole = int(value)
        elif name == "SWP_ST":
            self.reports = True
            if int(value) != self.state:
                self._enter(int(value), t)

    def _enter(self, state: int, t: float) -> None:
        self.state = state
        self._events.append(StateChanged(t, state, STATES.get(state, f"state {state}")))
        if 0 < state < STOPPED_STATE:
            self.active = True
        elif self.active or state == STOPPED_STATE:
            self.active = self.ended = True
            self.ended_at = t

    def _sample(self, t: float) -> None:
        if t - self._sampled < _SAMPLE_EVERY:
            return
        self._sampled = t
        self._events.append(Sample(t, self.state, self._pwm, self._r, self._ay, self.speed, self._frequency))


# A rover that reboots in a run: the applet then reports on the next boot, not on the run.


@dataclass(frozen=True)
class RebootWatch:
    """boots: reboots counted when the watch began."""

    clock: VehicleClock
    boots: int

    @classmethod
    def since_now(cls, clock: VehicleClock) -> RebootWatch:
        """Watch for reboots from now on."""
        return cls(clock, clock.boots)

    @property
    def rebooted(self) -> bool:
        """Whether the vehicle rebooted since the watch began."""
        return self.clock.boots != self.boots

    def outcome(self, number: int, heard: tuple[bool, str]) -> tuple[bool, str]:
        """(completed, reason) of run `number` as `heard` from the applet, unless the rover rebooted in it.

        A run that the applet reported as complete before the reboot stays complete.
        """
        if heard[0] or not self.rebooted:
            return heard
        return False, f"the rover rebooted in run {number}; check its power supply, then drive the run again"
