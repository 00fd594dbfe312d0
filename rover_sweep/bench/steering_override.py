"""The override of the steering channel: repeated while it is active, and always released at its end."""

from __future__ import annotations

from rover_sweep.bench.steering_output import SteeringOutput
from rover_sweep.errors import RoverSweepError
from rover_sweep.vehicle.link.clock import Periodic
from rover_sweep.vehicle.link.link import Link

REFRESH = 0.2  # s of the vehicle's clock
_LEAVE, _RELEASE, _RELEASE_HIGH = 0xFFFF, 0, 0xFFFE  # channels 9.. take 65534 for "back to the radio"


class SteeringOverride:
    """A context in which the steering is ours. No other channel is ever sent; nothing before `to`."""

    def __init__(self, link: Link, output: SteeringOutput) -> None:
        self.offset = 0.0
        self._link, self._output = link, output
        self._periodic: Periodic | None = None

    def __enter__(self) -> SteeringOverride:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def to(self, offset: float) -> None:
        """The steering output `offset` us from its trim, at once."""
        self.offset = offset
        if self._periodic is None:
            self._periodic = self._link.every(REFRESH, self._send)
        else:
            self._send()

    def release(self) -> None:
        """Return the channel to the radio. Never raises for a lost link: then the override lapses."""
        if self._periodic is None:
            return
        self._link.cancel(self._periodic)
        self._periodic = None
        for _ in range(3):
            try:
                self._put(_RELEASE if self._output.channel <= 8 else _RELEASE_HIGH)
            except RoverSweepError:
                return

    def _send(self) -> None:
        self._put(self._output.stick_for(self.offset))

    def _put(self, value: int) -> None:
        fields = {f"chan{n}_raw": _LEAVE for n in range(1, 17)} | {f"chan{self._output.channel}_raw": value}
        self._link.to_vehicle("RC_CHANNELS_OVERRIDE", **fields, chan17_raw=0, chan18_raw=0)
