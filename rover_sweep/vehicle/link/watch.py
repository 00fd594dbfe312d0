"""Detects a vehicle that is silent, or sends no heartbeats."""

from __future__ import annotations

from dataclasses import dataclass
from math import log

from rover_sweep.errors import LinkError

SILENCE = 5.0  # s without any message from the vehicle
HEARTBEAT_LOSS = 10.0  # s of the vehicle's clock without a heartbeat while other messages come
_JUMP = 3.0  # s
_CHANCE = 1e-5  # probability that the link loses so many heartbeats in a row


@dataclass
class Watch:
    """Counts the time spent waiting without a message; time in which nobody reads does not count.

    lost: share of the frames that the link loses; the larger it is, the more heartbeats may be missing."""

    url: str
    lost: float = 0.0
    silent: float = 0.0  # s
    _heartbeat: float = 0.0  # vehicle's clock at the last one [s]
    _last: float | None = None  # and at the last message

    def waited(self, seconds: float, found: bool) -> None:
        """Nothing came for `seconds`. LinkError when that adds up to SILENCE. found: a vehicle was heard
        before."""
        self.silent += seconds
        if self.silent <= SILENCE:
            return
        if not found:
            raise LinkError(
                f"nothing was heard on {self.url} for {SILENCE:.0f} s; "
                "is a vehicle there, at that port or baud rate?"
            )
        raise LinkError(
            f"the vehicle on {self.url} has been silent for {SILENCE:.0f} s; check its power, the radio's "
            "range and the cable"
        )

    def heard(self, now: float | None, heartbeat: bool) -> None:
        """A message came at `now` on the vehicle's clock [s] (None: not known yet). LinkError if heartbeats
        are missing for too long. After a jump of the clock (nobody read, or a reboot) the count restarts."""
        self.silent = 0.0
        if now is None:
            return
        jumped = self._last is None or not 0 <= now - self._last <= _JUMP
        self._last = now
        if heartbeat or jumped:
            self._heartbeat = now
        elif now - self._heartbeat > (limit := self._limit()):
            raise LinkError(
                f"the vehicle on {self.url} sends messages but has sent no heartbeat for {limit:.0f} s of "
                "its clock; its main loop may hang: stop it by hand and read its messages"
            )

    def _limit(self) -> float:
        """Allowed time without a heartbeat [s]; the vehicle sends one a second."""
        return max(HEARTBEAT_LOSS, log(_CHANCE) / log(min(self.lost, 0.75))) if self.lost else HEARTBEAT_LOSS

    def forgive(self) -> None:
        """Restart the count: the vehicle is rebooting or booting."""
        self.silent, self._last = 0.0, None


class Unwatched(Watch):
    """A watch that never raises: the caller decides how long to wait."""

    def waited(self, seconds: float, found: bool) -> None:
        pass

    def heard(self, now: float | None, heartbeat: bool) -> None:
        pass
