"""Identify, diagnose and gains with their reports, computed in the background while runs are driven."""

from __future__ import annotations

from rich.text import Text
from textual.binding import Binding

from rover_sweep.tui.drawn import labels
from rover_sweep.tui.drawn.drawing import ScreenRows, cut_line, window, wrapped
from rover_sweep.tui.drawn.palette import Palette
from rover_sweep.tui.jobs.analysis import AnalysisJob
from rover_sweep.tui.screens.session_screen import SessionScreen

_SIGNS = {"running": "▶ working", "done": "✓ done", "failed": "✗ failed"}


class ResultsScreen(SessionScreen):
    """Each key starts the command of that name in a separate process; the session continues."""

    view = "results"
    BINDINGS = [
        Binding("i", "start('identify')", "identify"),
        Binding("d", "start('diagnose')", "diagnose"),
        Binding("s", "start('gains')", "gains"),
        Binding("o", "open", "open the report"),
        Binding("k", "stop", "stop it"),
        Binding("up", "choose(-1)", "choose"),
        Binding("down", "choose(1)", "choose"),
        Binding("pageup", "page(-1)", "more"),
        Binding("pagedown", "page(1)", "more"),
    ]
    chosen: int | None = None  # None: the latest
    down = 0  # rows scrolled down
    _last = 0  # largest value of down

    @property
    def jobs(self) -> tuple[AnalysisJob, ...]:
        return self.session.desk.jobs

    @property
    def job(self) -> AnalysisJob | None:
        return self.jobs[self.index] if self.jobs else None

    @property
    def index(self) -> int:
        """Index of the chosen job."""
        latest = len(self.jobs) - 1
        return latest if self.chosen is None else min(self.chosen, latest)

    def picture(self, width: int, height: int) -> Text:
        rows, palette = ScreenRows(self.palette, width, height), self.palette
        rows.sentence(self._from(), palette.ink, most=2)
        for n in window(len(self.jobs), self.index, 4):
            job = self.jobs[n]
            mark = "▶" if job is self.job and len(self.jobs) > 1 else " "
            took = labels.seconds(job.seconds) if job.seconds else "earlier"
            text = job.summary[0] if job.summary else job.last
            line = cut_line(f" {mark} {_SIGNS[job.outcome]:<10} {job.kind:<10} {took:>10}  {text}", width)
            if n == self.index:
                rows.filled(line, palette.inverse)
            else:
                rows.add(line, style=palette.ink)
        if self.job is not None:
            self._about(rows, self.job)
        return rows.text()

    def _from(self) -> str:
        """Sentence on the runs that can be analysed, or on what is missing."""
        if self.state.played is not None:
            return f"Identify this recording with: rover-sweep identify {self.state.url} --vehicle rover.toml"
        whole = [run.name for run in self.state.runs if run.outcome == "done"]
        if not whole:
            return "No complete run yet: nothing to identify."
        if self.session.setup.vehicle_path is None:
            return "No vehicle file: quit and start again with --vehicle rover.toml to identify here."
        report = self.session.desk.report(self.job)
        gains = f"S computes gains from {report.name}" if report else ""
        if self.state.logs:
            more = f"; {gains}" if gains else ""
        else:
            then = f", then {gains}" if gains else ""
            more = f" (from telemetry; press 6 and L to fetch the log{then})"
        return f"I identifies, D diagnoses {', '.join(whole)}{more}"

    def _about(self, rows: ScreenRows, job: AnalysisJob) -> None:
        palette = self.palette
        rows.blank()
        if job.page is not None:
            rows.sentence(f"report: {job.page} (O opens it)", f"bold {palette.accent}", most=2)
        lines = _result_lines(job, palette, rows.width - 2)
        room = max(1, rows.left - 1)
        self._last = max(0, len(lines) - room)
        at = self._last if job.outcome == "running" else min(self.down, self._last)
        for row, style in lines[at : at + room]:
            rows.add((f" {row}", style))
        if at < self._last:
            more = len(lines) - at - room
            rows.add(f" ... {more} more row{'s' * (more > 1)} (PGDN)", style=palette.quiet)

    def action_page(self, step: int) -> None:
        self.down = min(max(0, self.down + 8 * step), self._last)
        self.redraw()

    def action_start(self, kind: str) -> None:
        self.session.analyse(kind, self.job)
        self.chosen, self.down = None, 0
        self.redraw()

    def action_open(self) -> None:
        if self.job is not None and self.job.page is not None:
            self.session.open_page(self.job.page)

    def action_stop(self) -> None:
        if self.job is not None:
            self.session.desk.stop(self.job)

    def action_choose(self, step: int) -> None:
        self.chosen, self.down = (self.index + step) % max(1, len(self.jobs)), 0
        self.redraw()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action == "start":
            return self.session.can_analyse(str(parameters[0]))
        if action == "open":
            return self.job is not None and self.job.page is not None
        if action == "stop":
            return self.job is not None and self.job.outcome == "running"
        if action == "page":
            return self._last > 0
        return action != "choose" or len(self.jobs) > 1


def _result_lines(job: AnalysisJob, palette: Palette, width: int) -> list[tuple[str, str]]:
    """(row, style) of the summary, its first sentence bold; without a summary, of the output."""
    lines = [
        (row, f"bold {palette.ink}" if n == 0 else palette.ink)
        for n, text in enumerate(job.summary)
        for row in wrapped(text, width)
    ]
    if job.summary:
        return lines
    ink = palette.bad if job.outcome == "failed" else palette.ink
    return [(row, ink) for line in job.lines for row in _fitted(line.rstrip(), width)]


def _fitted(line: str, width: int) -> list[str]:
    return wrapped(line, width) if len(line) > width else [line]
