"""Which autopilots are heard on a link, and whether there was time to hear a second one."""

from __future__ import annotations

from rover_sweep.vehicle.link.access import Heard
from rover_sweep.vehicle.link.clock import vehicle_seconds
from rover_sweep.vehicle.link.mavlink import Message, is_autopilot, sender, vehicle_type_name

HEARING = 1.2  # s after the first heartbeat; ArduPilot sends one a second


class RollCall:
    """heartbeats: the last one of each autopilot, by system id, in the order in which they were heard.

    only: the system id to wait for, None: any.
    """

    def __init__(self, only: int | None = None) -> None:
        self._only = only
        self.heartbeats: dict[int, Message] = {}
        self._began: float | None = None
        self._clock: tuple[int, float, float] | None = None  # of a vehicle: its id, first and last time [s]

    def hear(self, message: Message, now: float) -> None:
        """Take a message of any sender. now [s]: of a clock that never goes back."""
        system = sender(message)[0]
        if is_autopilot(message):
            self.heartbeats[system] = message
            if self._only in (None, system) and self._began is None:
                self._began = now
        seconds = vehicle_seconds(message)
        if seconds is None or system not in self.heartbeats:
            return
        if self._clock is None:
            self._clock = (system, seconds, seconds)
        elif self._clock[0] == system:
            self._clock = (system, self._clock[1], seconds)

    def over(self, now: float) -> bool:
        """Whether all vehicles had time to be heard: HEARING has passed by our clock, or by that of a vehicle
        that is simulated faster than real time. With `only`, it is enough to hear that one."""
        if self._began is None:
            return False
        passed = self._clock[2] - self._clock[1] if self._clock is not None else 0.0
        return self._only is not None or max(now - self._began, passed) >= HEARING

    @property
    def heard(self) -> tuple[Heard, ...]:
        """All autopilots heard, by id; with `only`, at most that one."""
        return tuple(
            heard_as(message)
            for system, message in sorted(self.heartbeats.items())
            if self._only in (None, system)
        )

    def others(self) -> str:
        """The autopilots heard, as a list in words; '' if none."""
        return ", ".join(str(heard_as(m)) for _, m in sorted(self.heartbeats.items()))


def heard_as(heartbeat: Message) -> Heard:
    """The sender of a heartbeat."""
    return Heard(sender(heartbeat)[0], vehicle_type_name(heartbeat.type))
