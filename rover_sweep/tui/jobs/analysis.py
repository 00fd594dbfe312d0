"""Commands that work on recordings, run as separate processes: the session never waits for them.

An `AnalysisJob` shows what the command printed and the JSON it wrote. Both are there without a screen.
"""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections.abc import AsyncGenerator, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Literal

from rover_sweep.tui.jobs.summary import page_of, summary_of

_KEPT = 200  # lines kept of a command's output
_TICK = 1.0  # s between updates of a job without output
_GRACE = 2.0  # s to terminate before it is killed
_NICENESS = 10  # gives priority to the vehicle's messages


@dataclass(frozen=True)
class AnalysisJob:
    """A command. lines: its output, the latest last; summary: from its JSON; page: its report; source: the
    folder that gains are computed from."""

    kind: str
    arguments: tuple[str, ...]
    out: Path | None = None
    outcome: Literal["running", "done", "failed"] = "running"
    lines: tuple[str, ...] = ()
    output: str = ""
    seconds: float = 0.0
    summary: tuple[str, ...] = ()
    page: Path | None = None
    process: int | None = None
    source: Path | None = None

    @property
    def last(self) -> str:
        """The latest line of output."""
        return self.lines[-1] if self.lines else ""


async def run_job(job: AnalysisJob) -> AsyncGenerator[AnalysisJob, None]:
    """Yield the job at every change, to its end. Closing the iterator ends the process."""
    began = time.monotonic()
    program = (sys.executable, "-m", "rover_sweep", *job.arguments)
    process = await asyncio.create_subprocess_exec(
        *program,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        preexec_fn=_own_session,
    )
    assert process.stdout is not None and process.stderr is not None
    output = asyncio.create_task(process.stdout.read())
    try:
        job = replace(job, process=process.pid)
        yield job
        reading = asyncio.create_task(process.stderr.readline())
        while True:
            done, _ = await asyncio.wait({reading}, timeout=_TICK)
            text = ""
            if done:
                if not (line := reading.result()):
                    break
                text = line.decode(errors="replace").rstrip()
                reading = asyncio.create_task(process.stderr.readline())
            lines = (*job.lines[-_KEPT:], text) if text.strip() else job.lines
            job = replace(job, lines=lines, seconds=time.monotonic() - began)
            yield job
        job = replace(job, output=(await output).decode(errors="replace"))
        code = await process.wait()
    finally:
        if process.returncode is None:
            await _end(process)
    yield ended(replace(job, seconds=time.monotonic() - began), code)


async def _end(process: asyncio.subprocess.Process) -> None:
    process.terminate()
    try:
        await asyncio.wait_for(process.wait(), _GRACE)
    except TimeoutError:
        process.kill()
        await process.wait()


def ended(job: AnalysisJob, code: int) -> AnalysisJob:
    """The job with outcome, output, summary and page, by its exit code (130: interrupted, with a report)."""
    lines = tuple(row for row in (*job.output.splitlines(), *job.lines) if row.strip())[-_KEPT:]
    if code not in (0, 130):
        return replace(
            job, outcome="failed", lines=lines or (f"it ended with exit code {code}",), process=None
        )
    summary = summary_of(job.kind, job.out) if job.out is not None else ()
    page = page_of(job.kind, job.out) if job.out is not None else None
    return replace(job, outcome="done", lines=lines, summary=summary, page=page, process=None)


def _own_session() -> None:
    os.setsid()  # so that Ctrl-C reaches only the screen
    os.nice(_NICENESS)


def gains_of(report: Path, logs: Sequence[Path], out: Path) -> tuple[str, ...]:
    """The command line of `gains`; logs: of the vehicle, with its current parameters."""
    now = ("--now", str(logs[-1])) if logs else ()
    return ("gains", str(report), *now, "--out", str(out))


def arguments_of(kind: str, recordings: Sequence[Path], vehicle: Path, out: Path) -> tuple[str, ...]:
    """The command line of `identify` or `diagnose`."""
    return (kind, *(str(path) for path in recordings), "--vehicle", str(vehicle), "--out", str(out))


def free_path(folder: Path, name: str, taken: Collection[Path] = ()) -> Path:
    """The first path of report, report-2, ... that neither exists nor is taken by a running job."""
    stem, suffix = Path(name).stem, Path(name).suffix
    numbered = (folder / (f"{stem}-{n}{suffix}" if n > 1 else name) for n in count(1))
    return next(path for path in numbered if not path.exists() and path not in taken)
