"""The current run: the pilot's task, the rover's signals, and how to abort."""

from __future__ import annotations

import math

from rich.text import Text
from textual.binding import Binding

from rover_sweep.manoeuvre.sweep import Doublet
from rover_sweep.tui.drawn import labels
from rover_sweep.tui.drawn.drawing import ScreenRows
from rover_sweep.tui.drawn.gauges import bar, fixed_width
from rover_sweep.tui.drawn.large_text import big, huge
from rover_sweep.tui.model.pilot import task
from rover_sweep.tui.model.state import RunRecord, State
from rover_sweep.tui.screens import signals
from rover_sweep.tui.screens.frame import ABORT_WORDS
from rover_sweep.tui.screens.session_screen import SessionScreen


class RunScreen(SessionScreen):
    """G drives the next row of the plan; SPACE and ESC end the run at once."""

    view = "run"
    BINDINGS = [Binding("g", "go", "drive the next")]

    def picture(self, width: int, height: int) -> Text:
        rows = ScreenRows(self.palette, width, height)
        self._title(rows)
        self._to_do(rows)
        self._progress(rows)
        signals.draw_signals(rows, self.state, self.session.setup, _tall(height))
        rows.blank()
        self._facts(rows)
        abort = 7 if height > 40 else 5 if height > 30 else 3
        rows.down_to(height - abort)
        self._abort(rows, abort)
        return rows.text()

    def action_go(self) -> None:
        self.session.drive_next()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        return action != "go" or self.session.may_drive

    def _title(self, rows: ScreenRows) -> None:
        state, palette = self.state, self.palette
        run = state.run
        if state.played is None and (state.driving is None or run is None):
            row = self.session.next_row
            following = (
                f"next: {labels.manoeuvre(row.manoeuvre)} at {row.speed:g} m/s"
                if row
                else "the plan is complete"
            )
            waits = ", computing its verdict" if run and _waits(run) else ""
            last = f"{run.name} {labels.OUTCOMES[run.outcome][1]}{waits}; " if run else ""
            rows.add(f" {last}{following}", style=f"bold {palette.ink}")
            return
        if run is None:
            rows.blank()
            return
        speed = self.session.driving_speed
        at = f" at {speed:g} m/s" if math.isfinite(speed) else ""
        lasts = labels.seconds(run.manoeuvre.duration)
        rows.add(f" {run.name}: {labels.manoeuvre(run.manoeuvre)}{at}, {lasts}", style=f"bold {palette.ink}")

    def _to_do(self, rows: ScreenRows) -> None:
        now = task(self.state, self.session.driving_speed)
        palette = self.palette
        style = palette.asking if now.urgent else f"bold {palette.accent}"
        if now.big:
            for line in huge(now.big) if _roomy(rows) else big(now.big):
                rows.filled(f"  {line}", style)
        rows.sentence(f"{now.big + ': ' if now.big else ''}{now.sentence}", f"bold {palette.ink}", most=2)
        if not now.big:
            rows.blank(3)

    def _progress(self, rows: ScreenRows) -> None:
        state, now = self.state, self.state.snapshot
        progress = now.progress if now else math.nan
        run = state.run
        left = ""
        if run is not None and math.isfinite(progress) and state.driving is not None:
            left = f"{labels.seconds((1 - progress) * run.manoeuvre.duration)} left"
        what = labels.APPLET.get(state.applet, f"state {state.applet}")
        if run is not None and run.manoeuvre.kind == "throttle":
            what = what.replace("steers", "sweeps the throttle")
        width = max(10, rows.width - 64)
        frequency = fixed_width(now.frequency if now else math.nan, "5.1f")
        tone = "" if run is not None and isinstance(run.manoeuvre, Doublet) else f"{frequency} rad/s"
        rows.add(
            f" applet {what:<19.19} {bar(progress, width)} {fixed_width(100 * progress, '3.0f')} %  "
            f"{tone:<12} {left}",
            style=self.palette.ink,
        )

    def _facts(self, rows: ScreenRows) -> None:
        now = self.state.snapshot
        if now is None:
            rows.sentence("No message from the rover yet.", self.palette.quiet)
            return
        armed = "ARMED" if now.armed else "disarmed"
        heard = f"{now.received:.0f} messages/s, " if math.isfinite(now.received) else ""
        before = "last heard: " if self.state.lost else ""
        rows.add(
            f" {before}{armed}, {labels.mode_label(now.mode)}, switch {labels.switch_label(now.switch)}, "
            f"{heard}recorded {labels.size(now.recorded)}",
            style=self.palette.ink,
        )
        if now.link and not self.state.lost:
            rows.sentence(now.link, self.palette.bad, most=2)

    def _abort(self, rows: ScreenRows, height: int) -> None:
        palette = self.palette
        if not self.state.under_way:
            if height > 3:
                rows.blank(height - 3)
            rows.blank(1).sentence(_way_out(self.state), palette.quiet, most=2)
            return
        words = f"{ABORT_WORDS}: ends the run at once"
        picture = [f"  {line}   " for line in (huge if height > 5 else big)("ABORT")]
        picture[len(picture) // 2] += words
        for line in ["", *picture, ""] if height > 3 else picture:
            rows.filled(line, palette.alarming)


def _way_out(state: State) -> str:
    if state.played is not None:
        return "SPACE pauses, , and . jump 10 s, + and - change the speed."
    return "SPACE or ESC ends a run; without this laptop: switch low, disarm or change the mode."


def _waits(run: RunRecord) -> bool:
    return run.outcome == "done" and run.verdict is None and not run.reason


def _roomy(rows: ScreenRows) -> bool:
    """True if letters of five rows fit."""
    return rows.height > 40 and rows.width >= 150


def _tall(height: int) -> int:
    """Rows for the history of each signal."""
    return max(1, min(6, (height - 28) // 5)) if height > 34 else 1
