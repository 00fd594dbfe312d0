"""Slow computations in a thread of their own: verdicts on runs, and the runs in a fetched log."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Empty, SimpleQueue

from rover_sweep.errors import UsageError
from rover_sweep.live.snapshot import Verdict

Span = tuple[float, float]


@dataclass(frozen=True)
class Given:
    """A verdict, and the tlog of the run that it is on."""

    tlog: Path
    verdict: Verdict


class Background:
    """One thread, which judges a run within a second, because the imports are loaded beforehand."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="beside the link")
        self._given: SimpleQueue[Given] = SimpleQueue()
        self._pool.submit(_load)

    def judge(self, tlog: Path, span: Span, name: str, vehicle_file: Path | None) -> None:
        """Begin to judge a run that came to its end."""
        self._pool.submit(lambda: self._given.put(Given(tlog, _judged(tlog, span, name, vehicle_file))))

    def tell(self, tlog: Path, verdict: Verdict) -> None:
        """A verdict that needs no computing, after those that are being worked on."""
        self._pool.submit(lambda: self._given.put(Given(tlog, verdict)))

    def given(self) -> Iterator[Given]:
        """The verdicts that were found since the last call."""
        while True:
            try:
                yield self._given.get_nowait()
            except Empty:
                return

    def work(self, work: Callable[[], None]) -> Future[None]:
        """Run any other work in the thread."""
        return self._pool.submit(work)

    def close(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)


def _load() -> None:
    """The imports of a verdict take longer than the verdict."""
    import scipy.signal  # noqa: F401


def _judged(tlog: Path, span: Span, name: str, vehicle_file: Path | None) -> Verdict:
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.live.verdict.run_verdict import judge

    try:
        return judge(tlog, span, name, load(vehicle_file) if vehicle_file else None)
    except UsageError as error:  # a vehicle file that was written into meanwhile
        return replace(judge(tlog, span, name), remarks=(str(error),))
    except Exception as error:  # a failed verdict must not end the session
        return Verdict(
            name, "repeat", f"it could not be judged ({error!r}); its recording is kept", source=tlog
        )
