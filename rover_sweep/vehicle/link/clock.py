"""The vehicle's clock, and periodic actions on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from rover_sweep.vehicle.link.mavlink import Message, kind

_MICROSECONDS_OF_BOOT = frozenset({"RAW_IMU", "HIGHRES_IMU"})  # time_usec since boot in ArduPilot
_REWIND = 1.0  # s: a larger step back is a reboot, not messages out of order


def vehicle_seconds(message: Message) -> float | None:
    """The time since boot in a message [s]; None if it has none.

    Not for SERVO_OUTPUT_RAW: its 32-bit microseconds wrap after 71 minutes.
    """
    if kind(message) in _MICROSECONDS_OF_BOOT:
        return message.time_usec * 1e-6
    boot_ms = getattr(message, "time_boot_ms", None)
    return None if boot_ms is None else boot_ms * 1e-3


@dataclass
class VehicleClock:
    """now: latest time since boot [s]; known: whether there is one; boots: number of reboots.

    A reboot is two messages in a row with an earlier time; a single one is a late message.
    """

    now: float = 0.0
    known: bool = False
    boots: int = 0
    _earlier: float | None = None

    def update(self, message: Message) -> None:
        seconds = vehicle_seconds(message)
        if seconds is None:
            return
        if self.known and seconds < self.now - _REWIND:
            self._went_back(seconds)
            return
        self.now, self.known, self._earlier = max(self.now, seconds), True, None

    def _went_back(self, seconds: float) -> None:
        if self._earlier is None or seconds < self._earlier:
            self._earlier = seconds
            return
        self.boots, self.now, self._earlier = self.boots + 1, seconds, None


@dataclass
class Periodic:
    """An action every `interval` s of the vehicle's clock or of ours, which of them is faster.

    The vehicle's clock serves a rover that is simulated faster than real time. Ours keeps the heartbeat going
    while the vehicle sends no time.
    """

    interval: float
    action: Callable[[], None]
    _vehicle: float = field(default=float("-inf"), init=False)
    _wall: float = field(default=float("-inf"), init=False)

    def run_if_due(self, vehicle: float, wall: float) -> None:
        if vehicle < self._vehicle:  # rebooted
            self._vehicle = float("-inf")
        if vehicle - self._vehicle >= self.interval or wall - self._wall >= self.interval:
            self._vehicle, self._wall = vehicle, wall
            self.action()
