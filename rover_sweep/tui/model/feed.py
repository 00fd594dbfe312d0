"""Queue from the source's thread to the screen's; fast values replace those not yet taken."""

from __future__ import annotations

import threading
from collections.abc import Callable

from rover_sweep.live.snapshot import Snapshot
from rover_sweep.live.source import Played, Update
from rover_sweep.vehicle.events import LogProgress, Sample

_FAST = (Snapshot, Played, LogProgress, Sample)


class Feed:
    """`put` in any thread, `take` in the screen's; `wake` is called at the first `put` after a `take`."""

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake, self._lock = wake, threading.Lock()
        self._waiting: list[Update] = []

    def put(self, message: Update) -> None:
        """Add a message without blocking; of the fast values only the latest of each type is kept."""
        with self._lock:
            first = not self._waiting
            if isinstance(message, _FAST):
                self._waiting = [other for other in self._waiting if type(other) is not type(message)]
            self._waiting.append(message)
        if first:
            self._wake()

    def take(self) -> list[Update]:
        """All waiting messages, oldest first."""
        with self._lock:
            taken, self._waiting = self._waiting, []
        return taken
