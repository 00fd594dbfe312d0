"""A rover that reboots in a run: the applet then reports on the next boot, not on the run."""

from __future__ import annotations

from dataclasses import dataclass

from rover_sweep.vehicle.link.clock import VehicleClock


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
