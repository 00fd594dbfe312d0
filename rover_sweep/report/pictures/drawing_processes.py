"""Pictures drawn on all processors: matplotlib holds Python's lock, so each process draws some."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Protocol

from rover_sweep.files.orphans import end_with_parent

MOST = 4  # processes


class Drawable(Protocol):
    """A picture that can be drawn as PNG."""

    def png(self) -> bytes:
        """The figure as PNG bytes."""


_given: Sequence[Drawable] = ()  # what a forked process inherits: figures' functions cannot be sent to it


def pngs(pictures: Sequence[Drawable]) -> Iterator[bytes]:
    """The PNG of each picture, in their order, as soon as it is drawn; the bytes are those of one process.

    Elsewhere than on Linux and in the main thread, where a fork is safe, one after the other.
    """
    global _given
    processes = min(os.cpu_count() or 1, len(pictures), MOST)
    forks = sys.platform == "linux" and threading.current_thread() is threading.main_thread()
    if processes < 2 or not forks:
        yield from (picture.png() for picture in pictures)
        return
    _given = pictures
    try:
        with ProcessPoolExecutor(processes, multiprocessing.get_context("fork"), _begin) as pool:
            waiting = [pool.submit(_png, k) for k in range(len(pictures))]
            for k, one in enumerate(waiting):
                try:
                    yield one.result()
                except BrokenProcessPool:  # the system ended a process, for want of memory for one
                    yield pictures[k].png()
                except KeyboardInterrupt:
                    pool.shutdown(wait=False, cancel_futures=True)
                    raise
    finally:
        _given = ()


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches every process; the parent answers it
    end_with_parent()


def _png(k: int) -> bytes:
    return _given[k].png()
