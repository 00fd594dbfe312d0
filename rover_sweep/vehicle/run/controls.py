"""The controls of the ground station: RC override, arming, mode; and how they are released.

An override is sent in bursts. While we drive, each one moves the steering channel by a us or two, within the
dead zone. That shows the applet that this program is alive; without it, it goes to HOLD before the override
lapses. RC_OVERRIDE_TIME (3 s; 1.75 s in a run) after the last one the radio is in charge again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import cycle
from typing import Literal

from rover_sweep.errors import LinkError, RoverSweepError, UsageError
from rover_sweep.system import another_stop, hold_stops
from rover_sweep.vehicle.link.connection import Periodic
from rover_sweep.vehicle.link.link import Link, Refused
from rover_sweep.vehicle.parameters import read_present
from rover_sweep.vehicle.run.right_to_move import RightToMove

Trigger = Literal["override", "aux", "pilot"]

LOW, HIGH = 1100, 1900  # us; aux switches read below 1200 as low and above 1800 as high
MANUAL = 0  # custom_mode of Rover
SCRIPTING_1 = 300  # RCn_OPTION and auxiliary function of the applet's switch
_BURST, _GAP = 0.24, 0.55  # s
NEUTRAL_ZONE = 30.0  # us about its trim within which a stick is at rest, where the rover has no RCn_DZ
_ALIVE = (-1, 0, 1, 2)  # us, in turn: a lost message or two still leave a change
_IGNORE, _RELEASE, _RELEASE_HIGH = 0xFFFF, 0, 0xFFFE  # channels 9.. take 65534 for "back to the radio"
FORCE = 21196.0  # param2 of MAV_CMD_COMPONENT_ARM_DISARM: disarm even while it moves
AUX, ARM = "MAV_CMD_DO_AUX_FUNCTION", "MAV_CMD_COMPONENT_ARM_DISARM"
_ANSWER = 1.0  # s
INSISTS = 30.0  # s for which the order to disarm is repeated
MAY_BE_ARMED = (
    "The rover may still be armed: keep away from its wheels, and disarm it with the transmitter "
    "or switch its power off"
)
_TRIES = 5  # of a step of the release that is interrupted
_SETTLE = 0.6  # s that the applet needs to detect the switch (10 Hz, 200 ms debounce, 84 Hz script)


@dataclass(frozen=True)
class Channels:
    """RC channels (1-based) and their trims [us]."""

    steering: int
    throttle: int
    switch: int
    steering_trim: int
    throttle_trim: int


def find_channels(link: Link) -> Channels:
    """Read which RC channels steer, drive and trigger. UsageError if none triggers."""
    names = ["RCMAP_ROLL", "RCMAP_THROTTLE", "SWP_CHAN", *(f"RC{n}_OPTION" for n in range(1, 17))]
    have = read_present(link, names)
    steering, throttle = int(have.get("RCMAP_ROLL", 1)), int(have.get("RCMAP_THROTTLE", 3))
    trims = read_present(link, [f"RC{steering}_TRIM", f"RC{throttle}_TRIM"])
    if (switch := _switch(have)) in (steering, throttle):
        raise UsageError(
            f"SWP_CHAN {switch} is the channel of a stick; set it to that of a switch, or to 0 with "
            "RC6_OPTION 300"
        )
    return Channels(
        steering,
        throttle,
        switch,
        int(trims.get(f"RC{steering}_TRIM", 1500)),
        int(trims.get(f"RC{throttle}_TRIM", 1500)),
    )


def _switch(have: dict[str, float]) -> int:
    raw = int(have.get("SWP_CHAN", 0))
    if raw > 0:
        return raw
    for number in range(1, 17):
        if have.get(f"RC{number}_OPTION") == SCRIPTING_1:
            return number
    raise UsageError(
        "no RC channel triggers the applet: set RC6_OPTION to 300 (the check switch does), or "
        "SWP_CHAN to the number of a channel"
    )


def overridden(channels: Channels, trigger: Trigger, drive: bool) -> dict[int, int]:
    """The RC channels that a run overrides, each at rest [us]: throttle and steering at trim, switch low."""
    rest = dict[int, int]()
    if drive:
        rest |= {channels.steering: channels.steering_trim, channels.throttle: channels.throttle_trim}
    return rest | ({channels.switch: LOW} if trigger == "override" else {})


class Controls:
    """Overrides and arming of one run. Nothing is sent before the first call of a method.

    Throttle and switch are sent only while `right` holds; once it is lost they go to trim and low at once,
    and stay there.
    """

    def __init__(
        self, link: Link, channels: Channels, trigger: Trigger, drive: bool, right: RightToMove
    ) -> None:
        self.channels = channels
        self._link, self._trigger, self._drive, self._right = link, trigger, drive, right
        self._override: dict[int, int] = {}
        self._periodic: list[Periodic] = []
        self._armed_by_us = self._thrown = self._switch_is_ours = False
        self._alive = cycle(_ALIVE)

    def take(self) -> None:
        """Begin to override: the switch low and, if we drive, steering and throttle at trim."""
        self._override = overridden(self.channels, self._trigger, self._drive)
        if self._override:
            self._right.sends(self._override)
            self._periodic = [self._link.every(0.0, self._guard), bursts(self._link, self._refresh)]

    def throttle(self, us: int) -> None:
        """Set the throttle [us]; only if we drive."""
        if not self._drive:
            raise ValueError("the pilot has the throttle in this run")
        if self._override.get(self.channels.throttle) != us and self._right.holds():
            self._override[self.channels.throttle] = us
            self._right.sends(self._override)
            self._refresh()

    def throw(self) -> None:
        """Throw the applet's switch, once in a run; the pilot's switch is not touched."""
        if self._thrown:
            raise ValueError("the switch was thrown before; another run needs a new consent")
        self._thrown = True
        if self._trigger == "pilot" or not self._right.holds():
            return
        if self._trigger == "override":
            self._override[self.channels.switch] = HIGH
            self._right.sends(self._override)
            self._refresh()
        elif self._trigger == "aux":
            self._switch_is_ours = True
            self._link.require("take the switch", AUX, float(SCRIPTING_1), 2.0, tries=1)

    def arm(self) -> None:
        """Switch to MANUAL and arm. LinkError with the vehicle's reasons if it refuses."""
        self._link.require("switch to MANUAL", "MAV_CMD_DO_SET_MODE", 1.0, float(MANUAL))
        self._armed(True)  # before the command: an answer that is lost must not leave it armed
        try:
            self._link.require("arm", ARM, 1.0)
        except Refused:
            self._armed(False)
            raise

    def _armed(self, by_us: bool) -> None:
        self._armed_by_us = self._link.may_be_armed = by_us

    def let_go(self) -> list[str]:
        """Switch low, throttle to trim, disarm if we armed, release the override. Returns sentences on what
        failed.

        The first message stops everything and is sent at once; the rest confirms it. Never raises for a lost
        link: then the rover stops without us.
        """
        failures: list[str] = []
        hold_stops()
        with self._link.unwatched():
            try:
                with another_stop():
                    for step in (self._stop_now, self._settle, self._end_aux, self._disarm, self._release):
                        self._attempt(step, failures)
            except KeyboardInterrupt:  # a second Ctrl-C: no more waiting
                for step in (self._stop_now, self._disarm_blind, self._release):
                    self._attempt_again(step, failures)
                if self._armed_by_us and not any(MAY_BE_ARMED in failure for failure in failures):
                    failures.append(MAY_BE_ARMED)
        for periodic in self._periodic:
            self._link.cancel(periodic)
        return failures

    def _attempt_again(self, step: Callable[[], None], failures: list[str]) -> None:
        """As `_attempt`; from the beginning, where an interrupt meets it."""
        for _ in range(_TRIES):
            try:
                return self._attempt(step, failures)
            except KeyboardInterrupt:
                continue
        return None

    def _attempt(self, step: Callable[[], None], failures: list[str]) -> None:
        try:
            try:
                step()
            except UsageError as error:  # the disk is full, which is reported once; stopping goes on
                failures.append(str(error))
                step()
        except RoverSweepError as error:
            failures.append(str(error))

    def _stop_now(self) -> None:
        self._at_rest()
        if self._override:
            self._send_override()

    def _at_rest(self) -> None:
        """Throttle and steering at trim, the switch low, from the next message on."""
        if self._override:
            self._override = overridden(self.channels, self._trigger, self._drive)

    def _settle(self) -> None:
        if self._override:
            pump(self._link, _SETTLE)

    def _end_aux(self) -> None:
        if self._switch_is_ours:
            self._insist("set the switch low", lambda: self._tried(AUX, float(SCRIPTING_1), 0.0))
            self._switch_is_ours = False

    def _disarm(self) -> None:
        if not self._armed_by_us:
            return
        orders = iter([(0.0,), *[(0.0, FORCE)] * 1000])  # a rover that moves refuses the first
        try:
            self._insist("disarm", lambda: self._tried(ARM, *next(orders)) and self._is_disarmed())
        except LinkError as error:
            raise LinkError(f"{error}. {MAY_BE_ARMED}") from error
        self._armed(False)

    def _is_disarmed(self) -> bool:
        """Whether a heartbeat that came after the order reports it."""
        return self._link.wait_for("HEARTBEAT", 2.5) is not None and not self._link.armed

    def _tried(self, command: str, *params: float) -> bool:
        """Send a command once. Returns whether it was accepted; reopens the connection if it ended."""
        try:
            self._link.reopen_if_ended()
            return self._link.command(command, *params, timeout=_ANSWER, tries=1) == 0
        except LinkError:
            self._link.line.sleep(0.1)
            return False

    def _insist(self, what: str, done: Callable[[], bool]) -> None:
        """Try for `INSISTS` s of our clock. LinkError if it never succeeds."""
        deadline = self._link.line.monotonic() + INSISTS
        while not done():
            if self._link.line.monotonic() > deadline:
                raise LinkError(f"the rover did not confirm the order to {what} within {INSISTS:.0f} s")

    def _disarm_blind(self) -> None:
        if self._armed_by_us:
            try:
                accepted = self._link.command(ARM, 0.0, FORCE, timeout=0.3, tries=2) == 0
            except LinkError as error:
                raise LinkError(f"{error}. {MAY_BE_ARMED}") from error
            if not accepted:
                raise LinkError(MAY_BE_ARMED)
            self._armed(False)
            self._is_disarmed()  # so that an old heartbeat does not report it as armed

    def _release(self) -> None:
        for periodic in self._periodic:
            self._link.cancel(periodic)
        self._periodic = []
        if self._override:
            self._override = {n: _RELEASE if n <= 8 else _RELEASE_HIGH for n in self._override}
            for _ in range(3):
                self._send_override()
            self._override = {}

    @property
    def _moves(self) -> bool:
        """Whether the present override moves the rover, or starts a run."""
        throttle = self._override.get(self.channels.throttle, self.channels.throttle_trim)
        return throttle != self.channels.throttle_trim or self._override.get(self.channels.switch, LOW) != LOW

    def _guard(self) -> None:
        """At every pass of the link: stop as soon as the right to move is lost."""
        if self._moves and not self._right.holds() and self._right.lost:
            self._stop_now()

    def _refresh(self) -> None:
        if not self._moves or self._right.holds():
            self._send_override()
        elif self._right.lost:
            self._stop_now()

    def _send_override(self) -> None:
        fields = {f"chan{n}_raw": self._override.get(n, _IGNORE) for n in range(1, 17)}
        if self._drive and self._override.get(self.channels.steering) == self.channels.steering_trim:
            fields[f"chan{self.channels.steering}_raw"] += next(self._alive)
        self._link.to_vehicle("RC_CHANNELS_OVERRIDE", **fields, chan17_raw=0, chan18_raw=0)


def bursts(link: Link, action: Callable[[], None]) -> Periodic:
    """Do `action` three times in `_BURST` s and then not for `_GAP` s, until cancelled.

    The firmware takes an override as a sign of life of its radio, and reports the radio as lost 0.5 s after
    the last one (Rover/radio.cpp, 4.6.3). So only in a longer gap can the firmware detect that the
    transmitter failed, and the applet stop (measured on 4.6.3: it does in every gap).
    """
    gaps = cycle((_BURST / 2, _BURST / 2, _GAP))

    def step() -> None:
        periodic.interval = next(gaps)
        action()

    periodic = link.every(_GAP, step)
    return periodic


def pump(link: Link, seconds: float, wall_limit: float = 3.0) -> None:
    """Pump the link for `seconds` of the vehicle's clock, at most `wall_limit` s of ours."""
    start, deadline = link.clock.now, link.line.monotonic() + wall_limit
    while link.clock.now - start < seconds and link.line.monotonic() < deadline:
        link.receive(0.1)


# What the user allows this program to do in a run.


@dataclass(frozen=True)
class RunSettings:
    """What the user allows this program to do in a run.

    arm: arm the rover (the user's consent). throttle_us: drive with this throttle [us]; None: the pilot
    drives. trigger: throw the switch by RC override, by MAV_CMD_DO_AUX_FUNCTION, or ask the pilot. extra:
    limits and other numbers of the applet, named without prefix (v_max, roll_max, still, ...). patience: time
    to wait for the pilot, for arming and for the speed [s of the vehicle's clock].
    """

    arm: bool = False
    throttle_us: int | None = None
    trigger: Trigger = "pilot"
    extra: Mapping[str, float] = field(default_factory=dict)
    patience: float = 120.0

    def __post_init__(self) -> None:
        if self.throttle_us is None:
            return
        if not self.arm:
            raise UsageError("this program drives only a rover that it armed itself; allow arming too")
        if not 1000 <= self.throttle_us <= 2000:
            raise UsageError(f"throttle {self.throttle_us} us is out of range; give 1000 to 2000 us")
