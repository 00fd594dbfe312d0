"""Where the work runs: local processes (concurrent.futures) or a Dask cluster (dask.distributed)."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

from rover_sweep.errors import UsageError, missing_extra
from rover_sweep.files.orphans import end_with_parent

RETRIES = 3  # by Dask, of a log whose worker failed


def default_workers() -> int:
    """One for each processor that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def workers(count: int | None, scheduler: str | None) -> Iterator[Executor]:
    """An executor. scheduler: address of a Dask cluster, None for `count` local processes."""
    if scheduler is None:
        os.environ.setdefault("OMP_NUM_THREADS", "1")  # of the processes that start now
        context = multiprocessing.get_context("spawn")  # as on every platform, and no copied locks
        processes = count or default_workers()
        with ProcessPoolExecutor(processes, context, end_with_parent) as pool:
            yield pool
        return
    try:
        from distributed import Client
    except ImportError:
        raise missing_extra("--scheduler needs Dask", "fleet") from None
    try:
        client = Client(scheduler, timeout="20s")
    except (OSError, ValueError, TimeoutError) as error:
        raise UsageError(
            f"no Dask scheduler answers at {scheduler} ({error}); start one with: dask scheduler"
        ) from None
    with client, client.get_executor(retries=RETRIES, pure=False) as pool:
        yield pool
