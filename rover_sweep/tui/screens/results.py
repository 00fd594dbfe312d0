"""Identify, diagnose, gains and their reports, worked out beside the session while the next run is driven."""

from __future__ import annotations

from rich.text import Text
from textual.binding import Binding

from rover_sweep.tui import words
from rover_sweep.tui.analysis import Job
from rover_sweep.tui.drawing import Rows
from rover_sweep.tui.screens.base import SessionScreen

_SIGNS = {"running": "▶ working", "done": "✓ done", "failed": "✗ failed"}


class ResultsScreen(SessionScreen):
    """Each key starts the command of that name as a program of its own; the session goes on meanwhile."""

    view = "results"
    BINDINGS = [
        Binding("i", "start('identify')", "identify"),
        Binding("d", "start('diagnose')", "diagnose"),
        Binding("s", "start('gains')", "steering gains"),
        Binding("o", "open", "open the report"),
        Binding("k", "stop", "stop it"),
        Binding("up", "choose(-1)", "choose"),
        Binding("down", "choose(1)", "choose"),
    ]
    chosen = 0

    @property
    def jobs(self) -> tuple[Job, ...]:
        return self.session.desk.jobs

    @property
    def job(self) -> Job | None:
        return self.jobs[min(self.chosen, len(self.jobs) - 1)] if self.jobs else None

    def picture(self, width: int, height: int) -> Text:
        rows, palette = Rows(self.palette, width, height), self.palette
        rows.sentence(self._from(), palette.ink, most=2)
        for n, job in enumerate(self.jobs[-4:], max(0, len(self.jobs) - 4)):
            mark = "▶" if job is self.job and len(self.jobs) > 1 else " "
            took = words.seconds(job.seconds)
            line = f" {mark} {_SIGNS[job.outcome]:<10} {job.kind:<10} {took:>10}  {job.last}"
            if n == min(self.chosen, len(self.jobs) - 1):
                rows.filled(line, palette.inverse)
            else:
                rows.add(line, style=palette.ink)
        if self.job is not None:
            self._about(rows, self.job)
        return rows.text()

    def _from(self) -> str:
        """Out of what, and what is missing for more."""
        whole = [run.name for run in self.state.runs if run.outcome == "done"]
        if not whole:
            return "No run is whole yet: nothing to identify from."
        logs = "" if self.state.logs else " (out of the telemetry: no log is fetched yet, 6 and L)"
        gains = "S proposes gains" if self.session.desk.report else "then S proposes gains"
        return f"I identifies, D diagnoses, {gains}: {', '.join(whole)}{logs}"

    def _about(self, rows: Rows, job: Job) -> None:
        palette = self.palette
        rows.blank()
        for said in job.summary:
            rows.sentence(said, f"bold {palette.ink}" if said == job.summary[0] else palette.ink, most=4)
        if job.page is not None:
            rows.sentence(f"report: {job.page} (O opens it)", f"bold {palette.accent}", most=2)
        if not job.summary:
            for line in job.lines[-max(0, rows.left) :]:
                rows.add(f" {line}", style=palette.bad if job.outcome == "failed" else palette.quiet)

    def action_start(self, kind: str) -> None:
        self.session.analyse(kind)
        self.chosen = len(self.jobs) - 1
        self.redraw()

    def action_open(self) -> None:
        if self.job is not None and self.job.page is not None:
            self.session.open_page(self.job.page)

    def action_stop(self) -> None:
        if self.job is not None:
            self.session.desk.stop(self.job)

    def action_choose(self, step: int) -> None:
        self.chosen = (min(self.chosen, len(self.jobs) - 1) + step) % max(1, len(self.jobs))
        self.redraw()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action == "start":
            return self.session.can_analyse(str(parameters[0]))
        if action == "open":
            return self.job is not None and self.job.page is not None
        if action == "stop":
            return self.job is not None and self.job.outcome == "running"
        return action != "choose" or len(self.jobs) > 1
