"""Shortens the time after which an override lapses during a run, and restores it afterwards."""

from __future__ import annotations

from collections.abc import Mapping

from rover_sweep.errors import LinkError, RoverSweepError, UsageError
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.parameters.read_write import write_parameter

LAPSE, RADIO_MISSED, RADIO_MISSED_SINCE = "RC_OVERRIDE_TIME", "RC_FS_TIMEOUT", (4, 7)
_HURRIED, _TOO_SHORT = 1.5, 0.02  # times real time; s
SHORT: Mapping[str, float] = {
    LAPSE: 1.0,  # s that an override lasts after our last message; our longest gap is 0.55 s
    RADIO_MISSED: 0.5,  # s after which a lost radio is detected, in such a gap; fixed at 0.5 before 4.7
}


class Lapse:
    """present: parameters of the vehicle. began: an earlier moment on our clock and on the vehicle's [s];
    None if this run overrides nothing.

    A simulation that runs faster than real time keeps its values: its second is too short for us.
    """

    def __init__(self, link: Link, present: Mapping[str, float], began: tuple[float, float] | None) -> None:
        self._link, self._began = link, began or (0.0, 0.0)
        self._before = {name: present[name] for name in SHORT if began and name in present}
        self._changed: list[str] = []

    def shorten(self) -> None:
        """Set the short times. UsageError if the vehicle accepts no overrides."""
        if self._before.get(LAPSE) == 0:
            raise UsageError(
                f"{LAPSE} is 0: the rover accepts no throttle or switch from a ground station; set it to 3, "
                "or let the pilot drive and throw the switch"
            )
        if self._pace() > _HURRIED:
            return
        for name, before in self._before.items():
            if before != SHORT[name]:
                self._changed.append(name)
                write_parameter(self._link, name, SHORT[name])

    def _pace(self) -> float:
        """Seconds of the vehicle's clock per second of ours since `began`; 1 if that time is too short."""
        monotonic, vehicle = self._began
        ours = self._link.line.monotonic() - monotonic
        return (self._link.clock.now - vehicle) / ours if ours > _TOO_SHORT else 1.0

    def put_back(self, reachable: bool) -> list[str]:
        """Restore the values; returns a sentence for each failure. reachable: the vehicle is heard."""
        failures = []
        for name in self._changed:
            try:
                if not reachable:
                    raise LinkError("the rover is not heard")
                write_parameter(self._link, name, self._before[name])
            except RoverSweepError:
                failures.append(f"{name} is still {SHORT[name]:g} s; it was {self._before[name]:g} s before")
        return failures
