"""Ends a session in a browser when the server behind it dies: nobody could stop a run on that page."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable

EVERY = 0.2  # s


def end_with_parent(end: Callable[[], None], parent: Callable[[], int] = os.getppid) -> threading.Thread:
    """Call `end` once, from a thread, when the process has another parent than now."""
    first = parent()

    def watch() -> None:
        while parent() == first:
            time.sleep(EVERY)
        end()

    thread = threading.Thread(target=watch, name="server watch", daemon=True)
    thread.start()
    return thread
