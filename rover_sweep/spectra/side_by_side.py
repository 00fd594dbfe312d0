"""Independent work at the same time: compiled loops, transforms and matrix products release Python's lock."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

THREADS = 2
Item = TypeVar("Item")
Result = TypeVar("Result")
_here = threading.local()  # its `busy` is true in a thread that works for side_by_side already


def side_by_side(work: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """Results of work(item), in the order of items, on two threads; on one if called within such a thread.

    The results are the same as without threads, bit for bit.
    """
    if len(items) < 2 or getattr(_here, "busy", False):
        yield from map(work, items)
        return
    with ThreadPoolExecutor(THREADS, initializer=_begin) as pool:
        yield from pool.map(work, items)


@contextmanager
def one_thread() -> Iterator[None]:
    """Context without a second thread, for a process that is one of several."""
    before = getattr(_here, "busy", False)
    _here.busy = True
    try:
        yield
    finally:
        _here.busy = before


def _begin() -> None:
    _here.busy = True
