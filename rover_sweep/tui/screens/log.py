"""All runs of the session with outcome and verdict, and the messages of rover and program."""

from __future__ import annotations

from rich.text import Text
from textual.binding import Binding

from rover_sweep.live.source import FetchLogs
from rover_sweep.tui.drawn import labels
from rover_sweep.tui.drawn.drawing import ScreenRows, cells, wrapped
from rover_sweep.tui.drawn.gauges import bar
from rover_sweep.tui.model.state import RunRecord
from rover_sweep.tui.screens.frame import LEVELS
from rover_sweep.tui.screens.session_screen import SessionScreen
from rover_sweep.tui.screens.verdict import verdict_sentence


class LogScreen(SessionScreen):
    """L fetches the vehicle's logs; the vehicle must be disarmed."""

    view = "log"
    repeats_messages = False
    BINDINGS = [
        Binding("l", "fetch", "fetch the logs"),
        Binding("up", "scroll(1)", "older"),
        Binding("down", "scroll(-1)", "newer"),
        Binding("pageup", "scroll(10)", "older"),
        Binding("pagedown", "scroll(-10)", "newer"),
    ]
    back = 0

    def picture(self, width: int, height: int) -> Text:
        rows, palette, state = ScreenRows(self.palette, width, height), self.palette, self.state
        rows.add(
            f" runs: {len(state.runs)}, complete: {sum(r.outcome == 'done' for r in state.runs)}",
            style=f"bold {palette.ink}",
        )
        most = height // 2 - 2
        for run in state.runs[-most:]:
            rows.add(f" {run_line(run, width - 2)}", style=palette.ink)
        if state.fetching is not None:
            f = state.fetching
            share = f.done / f.total if f.total else 0.0
            rows.add(
                f" log {f.number}: {bar(share, 30)} {labels.size(f.done)} of {labels.size(f.total)}",
                style=palette.ink,
            )
        if state.armed and not state.under_way and state.played is None:
            rows.sentence("Disarm the rover to fetch its logs.", f"bold {palette.accent}")
        if state.logs:
            rows.sentence("on disk: " + ", ".join(path.name for path in state.logs), palette.good, most=2)
        rows.add("─" * width, style=palette.quiet)
        lines = [
            (row, {"warning": palette.doubtful, "error": f"bold {palette.bad}"}.get(line.level, palette.ink))
            for line in state.messages
            for row in wrapped(f"{LEVELS[line.level]}{line.text}", width - 2)
        ]
        end = len(lines) - min(self.back, max(0, len(lines) - rows.left))
        for row, style in lines[max(0, end - rows.left) : end]:
            rows.add(f" {row}", style=style)
        return rows.text()

    def action_fetch(self) -> None:
        self.session.ask(FetchLogs())

    def action_scroll(self, step: int) -> None:
        self.back = min(max(0, self.back + step), max(0, len(self.state.messages) - 1))
        self.redraw()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action != "fetch":
            return True
        state = self.state
        ready = state.vehicle is not None and state.played is None
        return ready and not state.busy and not state.armed


def run_line(run: RunRecord, width: int) -> str:
    """A run with its outcome and verdict in one line."""
    sign, outcome = labels.OUTCOMES[run.outcome]
    verdict = run.reason
    if run.verdict is not None:
        verdict = f"{labels.ADVICE[run.verdict.advice][0]} {verdict_sentence(run.verdict)}"
    return cells(
        (run.name, f"{sign} {outcome}", f"±{run.manoeuvre.amplitude:g} us", verdict), (13, 11, 8, width - 36)
    )
