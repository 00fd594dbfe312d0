"""The analysis jobs of a session, their recordings and results."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import time
from collections.abc import AsyncGenerator, Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from rover_sweep.files.documents import numbered, read_json
from rover_sweep.system import own_group, yield_to_others
from rover_sweep.tui.model.plan_rows import Row, rows_of_plan
from rover_sweep.tui.model.state import State

# Summary sentences from identification.json and diagnosis.json, whose keys are defined in `report`.


_DOCUMENTS = {"identify": "identification.json", "diagnose": "diagnosis.json", "gains": "gains.json"}
_PAGES = {"identify": "report.html", "diagnose": "diagnosis.html", "gains": "gains.html"}


def page_of(kind: str, out: Path) -> Path | None:
    """The HTML report, None if it does not exist."""
    names = (_PAGES[kind], *(("speed.html",) if kind == "identify" else ()))
    return next((out / name for name in names if (out / name).is_file()), None)


def summary_of(kind: str, out: Path) -> tuple[str, ...]:
    """Sentences, the main result first; the error if the document cannot be read."""
    words = _words(out / _DOCUMENTS[kind], kind)
    return words + _words(out / "speed.json", "speed") if kind == "identify" else words


def _words(path: Path, kind: str) -> tuple[str, ...]:
    """Sentences of one document, () without it."""
    if not path.is_file():
        return ()
    tell = {"identify": _identified, "diagnose": _diagnosed, "speed": _speed}.get(kind, _plain)
    try:
        return tuple(tell(read_json(path.read_text(encoding="utf-8"))))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return (f"{path} cannot be read: {error}",)


def next_runs(out: Path) -> tuple[str, ...]:
    """Runs that a diagnosis proposes, one sentence per finding; () without a diagnosis."""
    try:
        found = read_json((out / _DOCUMENTS["diagnose"]).read_text(encoding="utf-8"))["findings"]
        return tuple(dict.fromkeys(f"{f['effect']}: {f['next_run']}" for f in found if f.get("next_run")))
    except (OSError, ValueError, KeyError, TypeError):
        return ()


def _identified(document: Mapping[str, Any]) -> Iterator[str]:
    summary = document.get("summary")
    yield from (summary,) if isinstance(summary, str) else tuple(summary or ())
    recommended = document.get("recommended")
    if numbers := document.get("numbers"):
        yield "numbers (90 % intervals): " + ", ".join(_parameter(n, v, True) for n, v in numbers.items())
    for name, model in sorted(document["models"].items(), key=lambda item: item[0] != recommended):
        best = name == recommended
        values = ", ".join(
            _parameter(parameter, value, best)
            for parameter, value in model["parameters"].items()
            if value.get("free") and value.get("value") is not None and "variant" not in value
        )
        yield f"{name}{' (recommended; 90 % intervals)' if best else ''}: {values or 'no free parameters'}"


def _parameter(name: str, estimate: Mapping[str, Any], interval: bool) -> str:
    low, high = (estimate.get("interval_90") if interval else None) or (None, None)
    between = f" ({low:.3g} to {high:.3g})" if low is not None and high is not None else ""
    return f"{name} {estimate['value']:.3g}{between} {estimate['unit']}".rstrip()


def _speed(document: Mapping[str, Any]) -> Iterator[str]:
    low, _, high = document["speeds_m_s"]
    why = f": {document['reasons'][0]}" if document["reasons"] else ""
    yield f"speed {low:.2f} to {high:.2f} m/s, {document['level']}{why}"
    if document["law"]:
        names = (
            ("gain", "gain_m_s", "m/s per full throttle"),
            ("lag", "lag_s", "s"),
            ("delay", "delay_s", "s"),
        )
        ends = document["intervals"]
        yield ", ".join(
            f"{name} {document['law'][key]:.3g} ({ends[name][0]:.3g} to {ends[name][1]:.3g}) {unit}"
            for name, key, unit in names
        )


def _diagnosed(document: Mapping[str, Any]) -> Iterator[str]:
    yield f"{document['verdict'].upper()}: {document['sentence']}"
    for finding in document["findings"]:
        turn = finding.get("turn") or ""
        worth = f"{finding.get('importance') or ''} {turn[:1].upper()}{turn[1:]}".strip()
        yield f"{finding['effect']}: {worth or finding['sentence']}"
        if finding.get("next_run"):
            yield f"drive next, for {finding['effect']}: {finding['next_run']}"


def _plain(document: Mapping[str, Any]) -> Iterator[str]:
    for key in ("sentence", "summary", "verdict"):
        if isinstance(text := document.get(key), str) and text:
            yield text
    yield from (str(text) for text in document.get("sentences") or ())


# Commands that work on recordings, run as separate processes: the session never waits for them.
#
# They have a lower priority than the vehicle's messages, and Ctrl-C does not reach them.
# An `AnalysisJob` shows what the command printed and the JSON it wrote. Both are there without a screen.


_KEPT = 200  # lines kept of a command's output
_TICK = 1.0  # s between updates of a job without output
_GRACE = 2.0  # s to terminate before it is killed


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
        **own_group(yielding=True),
    )
    yield_to_others(process.pid)
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
        lines = lines or (f"it ended with exit code {code}",)
        return replace(job, outcome="failed", lines=lines, process=None)
    job = replace(job, outcome="done", lines=lines, process=None)
    if job.out is None:
        return job
    return replace(job, summary=summary_of(job.kind, job.out), page=page_of(job.kind, job.out))


NAMES = {"identify": "report", "diagnose": "diagnosis", "gains": "gains.param"}


def command_inputs(state: State, folder: Path) -> tuple[Path, ...]:
    """Input of a command: the session's folder if it has session.json, else its complete runs."""
    if (folder / "session.json").is_file():
        return (folder,)
    return tuple(run.tlog for run in state.runs if run.outcome == "done" and run.tlog is not None)


class Analyses:
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
        taken = {job.out for job in self.jobs}
        out = next(p for p in numbered(folder / NAMES[kind]) if not p.exists() and p not in taken)
        source = report if kind == "gains" else None
        if source is not None:  # with the current parameters, which the vehicle's log has
            given = (str(source), *(("--now", str(state.logs[-1])) if state.logs else ()))
        else:
            given = (*map(str, command_inputs(state, folder)), "--vehicle", str(vehicle))
        job = AnalysisJob(kind, (kind, *given, "--out", str(out)), out, source=source)
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
        self.proposing, self.proposal = "this takes about 20 s", ()

        def take(job: AnalysisJob, document: Any) -> None:
            self.proposal = rows_of_plan(document) if job.outcome == "done" else ()
            failed = f"no proposal: {job.last}" if job.outcome == "failed" else "no further runs are needed"
            self.proposing = "" if self.proposal else failed

        def refuse(error: Exception) -> None:
            self.proposing = f"no proposal: {error}"

        self._answer("plan", ("plan", "--vehicle", str(vehicle), "--json", *given), take, refuse)

    def choose_next(
        self, inputs: tuple[Path, ...], vehicle: Path, speed: float, add: Callable[[tuple[Row, ...]], object]
    ) -> None:
        """Start `rover-sweep investigate` on recorded runs; `add` gets the row to drive next, if any.

        speed: the largest [m/s].
        """
        runs = (str(path) for path in inputs)
        arguments = ("investigate", *runs, "--vehicle", str(vehicle), "--speed", f"{speed:g}", "--json")
        self.next_step, self.choosing = "diagnosing the runs; this takes up to a minute", True

        def take(job: AnalysisJob, document: Any) -> None:
            self.choosing = False
            self.next_step = str(document["sentence"]) if document else f"no next step: {job.last}"
            if rows := rows_of_plan(document):
                add(rows)

        def refuse(error: Exception) -> None:
            self.next_step, self.choosing = f"no next step: {error}", False

        self._answer("investigate", arguments, take, refuse)

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

    def _answer(
        self,
        kind: str,
        arguments: tuple[str, ...],
        take: Callable[[AnalysisJob, Any], object],
        refuse: Callable[[Exception], object],
    ) -> None:
        """Start a command that prints JSON. take: called at its end with the document, {} if it failed."""

        async def follow() -> None:
            job = AnalysisJob(kind, arguments)
            try:
                async with contextlib.aclosing(run_job(job)) as going:
                    async for going_on in going:
                        job = going_on
                take(job, json.loads(job.output) if job.outcome == "done" else {})
            except (OSError, ValueError, KeyError, TypeError) as error:
                refuse(error)
            self._tasks.pop(arguments, None)
            self._changed()

        self._tasks[arguments] = asyncio.create_task(follow())


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


def _as_option(row: Row) -> tuple[str, str]:
    """The row as an option of `rover-sweep plan`."""
    m = row.manoeuvre
    about = f"{getattr(m, 'bias', 0.0):+g}" if m.kind == "bias_sweep" else ""
    return f"--{row.kind}", f"{m.amplitude:g}{about}@{row.speed:g}"
