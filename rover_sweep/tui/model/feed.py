"""From the source's thread to the screen's: what is fast replaces what has not been looked at yet."""

from __future__ import annotations

import threading
from collections.abc import Callable

from rover_sweep.live.snapshot import Snapshot
from rover_sweep.live.source import Played, Update
from rover_sweep.vehicle.events import LogProgress, Sample

_FAST = (Snapshot, Played, LogProgress, Sample)


class Feed:
    """`tell` from any thread, `take` in the screen's; `wake` is called once until the next `take`."""

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake, self._lock = wake, threading.Lock()
        self._waiting: list[Update] = []

    def tell(self, told: Update) -> None:
        """Returns at once. Of the fast values only the latest of a kind waits."""
        with self._lock:
            first = not self._waiting
            if isinstance(told, _FAST):
                self._waiting = [other for other in self._waiting if type(other) is not type(told)]
            self._waiting.append(told)
        if first:
            self._wake()

    def take(self) -> list[Update]:
        """All that waits, oldest first."""
        with self._lock:
            taken, self._waiting = self._waiting, []
        return taken
