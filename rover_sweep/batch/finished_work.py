"""Work given to an executor, its results as they come. Scheduling and retries are the executor's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from rover_sweep.errors import RoverSweepError

Key = TypeVar("Key")
Progress = Callable[[int, int], None]
"""progress(done now, to do now)."""


def finished(
    pool: Executor,
    work: Callable[..., dict[str, Any]],
    given: Mapping[Key, tuple[Any, ...]],
    progress: Progress,
) -> Iterator[tuple[Key, dict[str, Any] | Exception]]:
    """(key, result of work(*arguments)) in the order in which they end.

    An exception instead of a result where a worker failed more often than the cluster retries.
    RoverSweepError where the local processes are lost.
    """
    progress(0, len(given))
    futures: dict[Future[dict[str, Any]], Key] = {}
    done = 0
    try:
        futures |= {pool.submit(work, *arguments): key for key, arguments in given.items()}
        for future in as_completed(futures):
            result: dict[str, Any] | Exception
            try:
                result = future.result()
            except BrokenProcessPool:
                raise
            except Exception as error:
                result = error
            yield futures[future], result
            done += 1
            progress(done, len(given))
    except BrokenProcessPool:
        raise RoverSweepError(
            f"a worker process ended unexpectedly (killed, or out of memory) after {done} of {len(given)}; "
            "finished work is kept: run the same command again"
        ) from None
    finally:
        for future in futures:
            future.cancel()  # what has not begun, after an error or Ctrl-C
