"""Stopping a command from outside: Ctrl-C, `kill`, a closed terminal."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


class Interruption:
    """A context in which the first Ctrl-C only requests a stop (`to_stop`), the second raises."""

    def __init__(self, on_request: Callable[[], object]) -> None:
        self._on_request, self._requested = on_request, False
        self._before: Any = None

    def to_stop(self) -> bool:
        """True once Ctrl-C has been pressed."""
        return self._requested

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():  # elsewhere signals cannot be caught
            self._before = signal.signal(signal.SIGINT, self._pressed)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _pressed(self, number: int, frame: FrameType | None) -> None:
        if self._requested:
            raise KeyboardInterrupt
        self._requested = True
        self._on_request()


@contextmanager
def let_go_on_signals() -> Iterator[None]:
    """Within it, `kill` and a closed terminal act like Ctrl-C, so that a rover is released at once.

    Ctrl-C also works in a program started in the background, where Python would ignore it. Under nohup a
    closed terminal has no effect.
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
