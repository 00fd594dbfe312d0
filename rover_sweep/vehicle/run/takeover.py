"""Before this program overrides RC channels, and afterwards: the sticks, and the applet's watch.

    takeover = Takeover(link, channels, throttle_us, present, began)
    takeover.check_sticks()     # before the first override
    takeover.declare()          # overrides go out from before until after it
    takeover.confirm()          # armed: the applet still watches
    takeover.end(reachable)     # sentences on what was not put back

While an override holds, neither this program nor the applet can see the stick beneath it. So the sticks are
looked at before, and afterwards the applet watches: once our overrides stop coming, or are no longer ours, it
puts the rover into HOLD before the override lapses (rover_sweep.lua, `laptop`). It also sets RC_OVERRIDE_TIME
for the run, in RAM only, and puts it back.
"""

from __future__ import annotations

from collections.abc import Mapping

from firmware_params.applet_parameters import SWITCH_HIGH
from rover_sweep.errors import LinkError, RoverSweepError, UsageError
from rover_sweep.system import another_stop
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters import read_parameter, read_present, write_parameter
from rover_sweep.vehicle.run.controls import NEUTRAL_ZONE, Channels, pump

OVERRIDE_TIME = "RC_OVERRIDE_TIME"
LAPSE = 1.75  # s that an override lasts after our last message; the applet acts 0.25 s earlier
_LONGEST = 3.0  # s, ArduPilot's default
_HURRIED, _TOO_SHORT = 1.5, 0.02  # times real time; s
_CLEARS = 4.0  # s within which the applet ends the watch over a station that is gone
_NO_RADIO = (0, 0xFFFF)
_LOOK = 0.2  # s


class Takeover:
    """throttle_us: of a run that this program drives, else None. present: parameters of the vehicle, with
    RC_OVERRIDE_TIME. began: an earlier moment on our clock and on the vehicle's [s]; None if this run
    overrides nothing: then every method returns at once."""

    def __init__(
        self,
        link: Link,
        channels: Channels,
        throttle_us: int | None,
        present: Mapping[str, float],
        began: tuple[float, float] | None,
    ) -> None:
        self._link, self._channels, self._throttle = link, channels, throttle_us
        self._overrides, self._began = began is not None, began or (0.0, 0.0)
        self._before = present.get(OVERRIDE_TIME, _LONGEST)
        self._declared = False

    def check_sticks(self) -> None:
        """UsageError if a stick that we are about to override is off its trim, or another station overrides.

        Such a stick would drive the rover as soon as our override ends.
        """
        if not self._overrides:
            return
        if self._before == 0:
            raise UsageError(
                f"{OVERRIDE_TIME} is 0: the rover accepts no throttle or switch from a ground station; "
                "set it to 3, or let the pilot drive and throw the switch"
            )
        self._refuse_second_station()
        if self._throttle is not None and self._link.armed:
            raise UsageError(
                "the rover is armed already, and this program drives only a rover that it armed itself: "
                "disarm it"
            )
        radio = self._link.request_message("RC_CHANNELS")
        if radio is None:
            raise LinkError(
                "the rover does not report its radio channels (RC_CHANNELS), so its sticks are unknown"
            )
        channels = self._channels
        self._refuse_high_switch(int(getattr(radio, f"chan{channels.switch}_raw")))
        if self._throttle is None:
            return
        for name, number, trim in (
            ("throttle", channels.throttle, channels.throttle_trim),
            ("steering", channels.steering, channels.steering_trim),
        ):
            self._refuse_off_trim(name, number, trim, int(getattr(radio, f"chan{number}_raw")))

    def _refuse_high_switch(self, us: int) -> None:
        if SWITCH_HIGH < us < _NO_RADIO[1]:
            raise UsageError(
                f"switch {self._channels.switch} is high ({us} us): it would start a run when this program's "
                "override of it ends; throw it low, then start again"
            )

    def _refuse_off_trim(self, name: str, number: int, trim: int, us: int) -> None:
        if us in _NO_RADIO:
            raise UsageError(
                f"the rover receives no {name} stick (RC{number} has no value); switch the transmitter on: "
                "it stops the rover without the laptop"
            )
        zone = read_present(self._link, [f"RC{number}_DZ"]).get(f"RC{number}_DZ", NEUTRAL_ZONE)
        if abs(us - trim) > zone:
            raise UsageError(
                f"the {name} stick (RC{number}) is at {us} us, its neutral at {trim} us (RC{number}_TRIM): "
                "the rover would follow the stick as soon as this program lets go. Centre the stick (one "
                f"without a spring stays there), then start again; its dead zone is {zone:g} us "
                f"(RC{number}_DZ)"
            )

    def _refuse_second_station(self) -> None:
        deadline = self._link.line.monotonic() + _CLEARS
        while (lapse := read_parameter(self._link, "SWP_LAPSE")) > 0:
            if self._link.line.monotonic() > deadline:
                raise UsageError(
                    f"another ground station overrides this rover (SWP_LAPSE {lapse:g} s): end it. If none "
                    "does, the applet ended while one did: reboot the rover"
                )
            pump(self._link, _LOOK)

    def declare(self) -> tuple[float, ...]:
        """Have the applet watch over our overrides, which go out already. Returns the values that
        RC_OVERRIDE_TIME may have from now on [s]. LinkError if the applet does not do it."""
        if not self._overrides:
            return ()
        self._declared = True
        lapse = (
            LAPSE if self._pace() <= _HURRIED else _LONGEST
        )  # our second is too short for a fast simulation
        write_parameter(self._link, "SWP_THR", float(self._throttle or 0))
        write_parameter(self._link, "SWP_LAPSE", lapse)
        deadline = self._link.line.monotonic() + _CLEARS
        while read_parameter(self._link, OVERRIDE_TIME) != lapse:
            if self._link.line.monotonic() > deadline:
                raise LinkError(
                    f"the applet does not set {OVERRIDE_TIME} to {lapse:g} s for the run; look for script "
                    "errors in the rover's messages"
                )
            pump(self._link, _LOOK)
        return lapse, self._before

    def confirm(self) -> None:
        """LinkError if the applet no longer watches over us."""
        if self._overrides and read_parameter(self._link, "SWP_LAPSE") == 0:
            raise LinkError(
                "the applet does not see this program's overrides: the link loses them (go closer), or the "
                "rover ignores them (RC_OPTIONS bit 1; SYSID_MYGCS other than 255, from 4.7 on MAV_GCS_SYSID)"
            )

    def _pace(self) -> float:
        """Seconds of the vehicle's clock per second of ours since `began`; 1 if that time is too short."""
        monotonic, vehicle = self._began
        ours = self._link.line.monotonic() - monotonic
        return (self._link.clock.now - vehicle) / ours if ours > _TOO_SHORT else 1.0

    def end(self, reachable: bool) -> list[str]:
        """End the watch, after our overrides; a sentence if RC_OVERRIDE_TIME is not as before.

        reachable: the vehicle is heard. What is said of the parameter was read from the vehicle, or it says
        that it was not.
        """
        if not self._declared:
            return []
        try:
            if not reachable:
                raise LinkError("the rover is not heard")
            with another_stop():
                write_parameter(self._link, "SWP_LAPSE", 0.0)
                return self._other_than_before()
        except (RoverSweepError, KeyboardInterrupt):  # another Ctrl-C: no more waiting
            return [
                f"{OVERRIDE_TIME} was {self._before:g} s before the run and could not be read after it; the "
                "applet puts it back once it misses this program, and a reboot does too"
            ]

    def _other_than_before(self) -> list[str]:
        deadline = self._link.line.monotonic() + _CLEARS
        while (now := read_parameter(self._link, OVERRIDE_TIME)) != self._before:
            if self._link.line.monotonic() > deadline:
                return [f"{OVERRIDE_TIME} is {now:g} s; it was {self._before:g} s before the run"]
            pump(self._link, _LOOK)
        return []
