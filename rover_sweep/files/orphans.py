"""Ends a process when the program that started it dies: nobody is left to stop it, or to use its result."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable

EVERY = 0.2  # s


def end_with_parent(
    end: Callable[[], object] | None = None, parent: Callable[[], int] = os.getppid
) -> threading.Thread:
    """Call `end` once, from a thread, when the process has another parent than now.

    By default the process ends at once: for the workers of a pool, which hold each other's pipes open, so
    that none of them sees that the program is gone.
    """
    first = parent()

    def watch() -> None:
        while parent() == first:
            time.sleep(EVERY)
        end() if end else os._exit(1)

    thread = threading.Thread(target=watch, name="parent watch", daemon=True)
    thread.start()
    return thread
