"""What the ground station may move: RC override, arming, mode; and how all of it is let go.

An override is refreshed at 5 Hz of the vehicle's clock and lapses after RC_OVERRIDE_TIME (3 s)
without us: then the radio is in charge again, or without a radio the RC failsafe.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from rover_sweep.errors import LinkError, RoverSweepError, UsageError
from rover_sweep.vehicle.clock import Periodic
from rover_sweep.vehicle.link import Link, Refused
from rover_sweep.vehicle.parameters import read_present

Trigger = Literal["override", "aux", "pilot"]

LOW, HIGH = 1100, 1900  # us; aux switches read below 1200 as low and above 1800 as high
MANUAL = 0  # custom_mode of Rover
SCRIPTING_1 = 300  # RCn_OPTION and auxiliary function of the applet's switch
_REFRESH = 0.2  # s
_IGNORE, _RELEASE, _RELEASE_HIGH = 0xFFFF, 0, 0xFFFE  # channels 9.. take 65534 for "back to the radio"
_FORCE = 21196.0
_SETTLE = 0.6  # s that the applet needs to see the switch (10 Hz, 200 ms debounce, 84 Hz script)


@dataclass(frozen=True)
class Channels:
    """RC channels (1-based) and their trims [us]."""

    steering: int
    throttle: int
    switch: int
    steering_trim: int
    throttle_trim: int


def find_channels(link: Link) -> Channels:
    """Read which RC channels steer, drive and trigger. UsageError where none triggers."""
    names = ["RCMAP_ROLL", "RCMAP_THROTTLE", "SWP_CHAN", *(f"RC{n}_OPTION" for n in range(1, 17))]
    have = read_present(link, names)
    steering, throttle = int(have.get("RCMAP_ROLL", 1)), int(have.get("RCMAP_THROTTLE", 3))
    trims = read_present(link, [f"RC{steering}_TRIM", f"RC{throttle}_TRIM"])
    return Channels(
        steering,
        throttle,
        _switch(have),
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
        "no RC channel triggers the applet: set RC6_OPTION to 300, or SWP_CHAN to the number of a channel"
    )


class Controls:
    """Overrides and arming of one run. Nothing is sent before the first call of a method."""

    def __init__(self, link: Link, channels: Channels, trigger: Trigger, drive: bool) -> None:
        self.channels = channels
        self._link, self._trigger, self._drive = link, trigger, drive
        self._override: dict[int, int] = {}
        self._periodic: Periodic | None = None
        self._armed_by_us = False

    def take(self) -> None:
        """Begin to override: the switch low and, where we drive, steering and throttle at trim."""
        if self._drive:
            self._override[self.channels.steering] = self.channels.steering_trim
            self._override[self.channels.throttle] = self.channels.throttle_trim
        if self._trigger == "override":
            self._override[self.channels.switch] = LOW
        if self._override:
            self._periodic = self._link.every(_REFRESH, self._send_override)

    def throttle(self, us: int) -> None:
        """Throttle [us]; only where we drive."""
        if not self._drive:
            raise ValueError("throttle is the pilot's in this run")
        if self._override.get(self.channels.throttle) != us:
            self._override[self.channels.throttle] = us
            self._send_override()

    def switch(self, high: bool) -> None:
        """Throw the applet's switch; a switch that is the pilot's is not touched."""
        if self._trigger == "override":
            self._override[self.channels.switch] = HIGH if high else LOW
            self._send_override()
        elif self._trigger == "aux":
            self._link.require(
                "take the switch", "MAV_CMD_DO_AUX_FUNCTION", float(SCRIPTING_1), 2.0 if high else 0.0
            )

    def arm(self) -> None:
        """MANUAL mode and arm. LinkError with the vehicle's reasons where it refuses."""
        self._link.require("go into MANUAL", "MAV_CMD_DO_SET_MODE", 1.0, float(MANUAL))
        self._armed_by_us = True  # before the command: an answer that is lost must not leave it armed
        try:
            self._link.require("arm", "MAV_CMD_COMPONENT_ARM_DISARM", 1.0)
        except Refused:
            self._armed_by_us = False
            raise

    def let_go(self) -> list[str]:
        """Switch low, throttle to trim, disarm if we armed, release the override. What failed, in words.

        The first message stops everything and goes out at once; the rest confirms it. Never raises
        for a lost link: what then stops the rover is on the rover.
        """
        failures: list[str] = []
        try:
            for step in (self._stop_now, self._settle, self._disarm, self._release):
                self._attempt(step, failures)
        except KeyboardInterrupt:  # a second Ctrl-C: no more waiting
            for step in (self._stop_now, self._disarm_blind, self._release):
                self._attempt(step, failures)
        if self._periodic is not None:
            self._link.cancel(self._periodic)
        return failures

    def _attempt(self, step: Callable[[], None], failures: list[str]) -> None:
        try:
            try:
                step()
            except UsageError as error:  # the disk is full, which is told once; stopping goes on
                failures.append(str(error))
                step()
        except RoverSweepError as error:
            failures.append(str(error))

    def _stop_now(self) -> None:
        if self._drive and self._override:
            self._override[self.channels.throttle] = self.channels.throttle_trim
            self._override[self.channels.steering] = self.channels.steering_trim
        if self._trigger == "override" and self._override:
            self._override[self.channels.switch] = LOW
        if self._override:
            self._send_override()
        if self._trigger == "aux":
            self._link.require("take the switch", "MAV_CMD_DO_AUX_FUNCTION", float(SCRIPTING_1), 0.0)

    def _settle(self) -> None:
        if self._override:
            pump(self._link, _SETTLE)

    def _disarm(self) -> None:
        if not self._armed_by_us:
            return
        if self._link.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0) != 0:
            self._link.require("disarm", "MAV_CMD_COMPONENT_ARM_DISARM", 0.0, _FORCE)
        self._armed_by_us = False
        self._link.wait_for("HEARTBEAT", 3.0, lambda _: not self._link.armed)
        if self._link.armed:
            raise LinkError(
                "the rover took the order to disarm but still says that it is armed; disarm it by hand"
            )

    def _disarm_blind(self) -> None:
        if self._armed_by_us:
            self._link.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0, _FORCE, timeout=0.3, tries=2)
            self._armed_by_us = False

    def _release(self) -> None:
        if self._periodic is not None:
            self._link.cancel(self._periodic)
            self._periodic = None
        if self._override:
            self._override = {n: _RELEASE if n <= 8 else _RELEASE_HIGH for n in self._override}
            for _ in range(3):
                self._send_override()
            self._override = {}

    def _send_override(self) -> None:
        fields = {f"chan{n}_raw": self._override.get(n, _IGNORE) for n in range(1, 17)}
        self._link.to_vehicle("RC_CHANNELS_OVERRIDE", **fields, chan17_raw=0, chan18_raw=0)


def pump(link: Link, seconds: float, wall_limit: float = 3.0) -> None:
    """Keep the link going for `seconds` of the vehicle's clock, at most `wall_limit` s of ours."""
    start, deadline = link.clock.now, link.line.monotonic() + wall_limit
    while link.clock.now - start < seconds and link.line.monotonic() < deadline:
        link.receive(0.1)
