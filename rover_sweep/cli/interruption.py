"""Ctrl-C that asks for an end at first, and takes it the second time."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any


class Interruption:
    """A context in which the first Ctrl-C is a wish (`to_stop`), the second a KeyboardInterrupt."""

    def __init__(self, told: Callable[[], object]) -> None:
        self._told, self._asked = told, False
        self._before: Any = None

    def to_stop(self) -> bool:
        """Has Ctrl-C been pressed."""
        return self._asked

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():  # elsewhere signals cannot be caught
            self._before = signal.signal(signal.SIGINT, self._pressed)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _pressed(self, number: int, frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True
        self._told()
