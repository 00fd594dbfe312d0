"""The analysis jobs of a session, their recordings and results."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from rover_sweep.tui.jobs.analysis import AnalysisJob, arguments_of, free_path, gains_of, run_job
from rover_sweep.tui.jobs.summary import next_runs, page_of, summary_of
from rover_sweep.tui.model.plan_rows import Row, rows_of_plan
from rover_sweep.tui.model.state import State

NAMES = {"identify": "report", "diagnose": "diagnosis", "gains": "gains.param"}


def command_inputs(state: State, folder: Path) -> tuple[Path, ...]:
    """Input of a command: the session's folder if it has session.json, else its complete runs."""
    if (folder / "session.json").is_file():
        return (folder,)
    return tuple(run.tlog for run in state.runs if run.outcome == "done" and run.tlog is not None)


class Desk:
    """Starts commands; `changed` is called at every change of one.

    proposal: rows proposed by `rover-sweep plan`; proposing: its status as text; next_runs: runs proposed by
    a diagnosis; next_step: the step chosen by `rover-sweep investigate`, with its reason; choosing: while it
    is computed.
    """

    def __init__(self, changed: Callable[[], object], folder: Path | None = None) -> None:
        self._changed = changed
        self.jobs: tuple[AnalysisJob, ...] = tuple(_before(folder)) if folder else ()
        self.proposal: tuple[Row, ...] = ()
        self.proposing = ""
        self.next_runs: tuple[str, ...] = ()
        self.next_step, self.choosing = "", False
        self._tasks: dict[tuple[str, ...], asyncio.Task[None]] = {}

    def start(self, kind: str, state: State, folder: Path, vehicle: Path, report: Path | None = None) -> None:
        """Start identify or diagnose into a new folder in `folder`, or gains from `report` into a .param file
        there."""
        taken = {job.out for job in self.jobs if job.out is not None}
        out = free_path(folder, NAMES[kind], taken)
        if kind == "gains" and report is not None:
            job = AnalysisJob(kind, gains_of(report, state.logs, out), out, source=report)
        else:
            job = AnalysisJob(kind, arguments_of(kind, command_inputs(state, folder), vehicle, out), out)
        self.jobs = (*self.jobs, job)
        self._tasks[job.arguments] = asyncio.create_task(self._follow(job))

    def report(self, chosen: AnalysisJob | None = None) -> Path | None:
        """Folder of an identification or diagnosis for gains: the chosen one, or that of the chosen gains,
        else the latest identification, else the latest diagnosis."""
        if chosen is not None and chosen.source is not None:
            return chosen.source
        done = [job for job in self.jobs if job.kind != "gains" and job.outcome == "done"]
        if chosen in done:
            return chosen.out
        done.sort(key=lambda job: job.kind == "identify")  # stable: within a kind in order of start
        return done[-1].out if done else None

    def stop(self, job: AnalysisJob) -> None:
        """End the process of a job."""
        if task := self._tasks.get(job.arguments):
            task.cancel()

    async def close(self) -> None:
        """End all jobs."""
        tasks = tuple(self._tasks.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def propose(self, rows: tuple[Row, ...], vehicle: Path) -> None:
        """Start `rover-sweep plan` to propose runs in addition to these rows."""
        given = [part for row in rows if row.kind != "throttle" for part in _as_option(row)]
        job = AnalysisJob("plan", ("plan", "--vehicle", str(vehicle), "--json", *given))
        self.proposing, self.proposal = "this takes about 20 s", ()
        self._tasks[job.arguments] = asyncio.create_task(self._proposed(job))

    def choose_next(
        self, inputs: tuple[Path, ...], vehicle: Path, speed: float, add: Callable[[tuple[Row, ...]], object]
    ) -> None:
        """Start `rover-sweep investigate` on recorded runs; `add` gets the row to drive next, if any.

        speed: the largest [m/s].
        """
        runs = (str(path) for path in inputs)
        arguments = ("investigate", *runs, "--vehicle", str(vehicle), "--speed", f"{speed:g}", "--json")
        job = AnalysisJob("investigate", arguments)
        self.next_step, self.choosing = "diagnosing the runs; this takes up to a minute", True
        self._tasks[arguments] = asyncio.create_task(self._chosen(job, add))

    async def _follow(self, job: AnalysisJob) -> None:
        mine = job.arguments
        try:
            async with contextlib.aclosing(run_job(job)) as going:
                async for job in going:
                    self._put(job)
        except asyncio.CancelledError:
            self._put(replace(job, outcome="failed", lines=(*job.lines, "stopped by you"), process=None))
        except OSError as error:
            self._put(replace(job, outcome="failed", lines=(f"cannot start: {error}",)))
        self._tasks.pop(mine, None)
        if job.kind == "diagnose" and job.outcome == "done" and job.out is not None:
            self.next_runs = next_runs(job.out)
        self._changed()

    def _put(self, job: AnalysisJob) -> None:
        self.jobs = tuple(job if other.arguments == job.arguments else other for other in self.jobs)
        self._changed()

    async def _proposed(self, job: AnalysisJob) -> None:
        try:
            async with contextlib.aclosing(run_job(job)) as going:
                async for going_on in going:
                    job = going_on
            self.proposal = rows_of_plan(json.loads(job.output)) if job.outcome == "done" else ()
            self.proposing = "" if self.proposal else _none(job)
        except (OSError, ValueError, KeyError, TypeError) as error:
            self.proposing = f"no proposal: {error}"
        self._tasks.pop(job.arguments, None)
        self._changed()

    async def _chosen(self, job: AnalysisJob, add: Callable[[tuple[Row, ...]], object]) -> None:
        try:
            async with contextlib.aclosing(run_job(job)) as going:
                async for going_on in going:
                    job = going_on
            document = json.loads(job.output) if job.outcome == "done" else {}
            self.next_step = str(document["sentence"]) if document else f"no next step: {job.last}"
            if rows := rows_of_plan(document):
                add(rows)
        except (OSError, ValueError, KeyError, TypeError) as error:
            self.next_step = f"no next step: {error}"
        self.choosing = False
        self._tasks.pop(job.arguments, None)
        self._changed()


def _before(folder: Path) -> Iterator[AnalysisJob]:
    """Finished jobs for the existing reports of a continued session."""
    for kind in ("identify", "diagnose"):
        for out in sorted(folder.glob(f"{NAMES[kind]}*/")):
            if page := page_of(kind, out):
                yield AnalysisJob(
                    kind, (kind, str(out)), out, "done", summary=summary_of(kind, out), page=page
                )
    for out in sorted(folder.glob("gains*.param")):
        lines = tuple(out.read_text(encoding="utf-8", errors="replace").splitlines())
        yield AnalysisJob("gains", ("gains", str(out)), out, "done", (*lines, f"parameters in {out}"))


def _none(job: AnalysisJob) -> str:
    if job.outcome == "failed":
        return f"no proposal: {job.last}"
    return "no further runs are needed"


def _as_option(row: Row) -> tuple[str, str]:
    """The row as an option of `rover-sweep plan`."""
    m = row.manoeuvre
    about = f"{getattr(m, 'bias', 0.0):+g}" if m.kind == "bias_sweep" else ""
    return f"--{row.kind}", f"{m.amplitude:g}{about}@{row.speed:g}"
