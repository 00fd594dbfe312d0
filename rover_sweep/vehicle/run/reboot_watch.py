"""A rover that reboots in a run: the applet's report is then that of the next boot, and says nothing."""

from __future__ import annotations

from dataclasses import dataclass

from rover_sweep.vehicle.link.clock import VehicleClock


@dataclass(frozen=True)
class RebootWatch:
    """Made before a run. boots: reboots counted until then."""

    clock: VehicleClock
    boots: int

    @classmethod
    def since_now(cls, clock: VehicleClock) -> RebootWatch:
        """Watch for reboots from now on."""
        return cls(clock, clock.boots)

    def outcome(self, number: int, heard: tuple[bool, str]) -> tuple[bool, str]:
        """(completed, reason) of run `number` as `heard` from the applet, unless the rover rebooted in it.

        A run that the applet called whole before the reboot stays whole.
        """
        if heard[0] or self.clock.boots == self.boots:
            return heard
        return False, f"the rover rebooted in run {number}; check its power supply, then drive the run again"
