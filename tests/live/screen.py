"""A screen that keeps what it is told."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TypeVar

from rover_sweep.live.played_source import PlayedSource
from rover_sweep.live.source import Played, Update

T = TypeVar("T")
PATIENCE = 30.0  # s


class Screen:
    """Starts a source and keeps all it tells, with the time of our clock."""

    def __init__(self, source: PlayedSource) -> None:
        self.source = source
        self.told: list[tuple[float, Update]] = []
        self._news = threading.Condition()
        source.start(self._tell)

    def _tell(self, told: Update) -> None:
        with self._news:
            self.told.append((time.monotonic(), told))
            self._news.notify_all()

    def all(self, kind: type[T]) -> list[T]:
        return [told for _, told in self.told if isinstance(told, kind)]

    def until(self, true: Callable[[], bool]) -> None:
        with self._news:
            assert self._news.wait_for(true, PATIENCE), "it never came"

    def at_the_end(self) -> bool:
        stands = self.all(Played)
        return bool(stands) and stands[-1].t >= stands[-1].length
