"""What ends a command from outside: Ctrl-C, `kill`, a closed terminal."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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


@contextmanager
def let_go_on_signals() -> Iterator[None]:
    """Meanwhile `kill` or a closed terminal ends like Ctrl-C: a rover is let go, not left to its timeout.

    So does Ctrl-C in a program that was started in the background, where Python would ignore it. Under nohup
    a closed terminal ends nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {getattr(signal, name): signal.getsignal(getattr(signal, name)) for name in names}
    for number, handler in before.items():
        if number == signal.SIGINT or handler != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
