"""The checks before a run: state, observed value, and the key that fixes it."""

from __future__ import annotations

from rich.text import Text
from textual.binding import Binding

from rover_sweep.live.source import Connect, Fix, Preflight
from rover_sweep.tui.drawn import labels
from rover_sweep.tui.drawn.drawing import ScreenRows, cells, window
from rover_sweep.tui.drawn.palette import Palette
from rover_sweep.tui.drawn.question import Question
from rover_sweep.tui.screens.session_screen import SessionScreen
from rover_sweep.vehicle.preflight.item import Check

_BELOW = 6  # rows for the text on the chosen check


class PreflightScreen(SessionScreen):
    """F fixes the chosen check; it asks first if that reboots the rover."""

    view = "preflight"
    BINDINGS = [
        Binding("f", "fix", "fix it"),
        Binding("up", "choose(-1)", "choose"),
        Binding("down", "choose(1)", "choose"),
        Binding("r", "look", "check again"),
    ]
    chosen: int | None = None  # None: the first that is not good

    @property
    def index(self) -> int:
        """Index of the chosen check."""
        checks = self.state.checks
        if self.chosen is not None:
            return min(self.chosen, len(checks) - 1)
        worst = (n for state in ("bad", "doubtful") for n, check in enumerate(checks) if check.state == state)
        return next(worst, 0)

    @property
    def check(self) -> Check | None:
        checks = self.state.checks
        return checks[self.index] if checks else None

    def picture(self, width: int, height: int) -> Text:
        rows, palette = ScreenRows(self.palette, width, height), self.palette
        checks, chosen = self.state.checks, self.index
        shown = window(len(checks), chosen, height - 2 - _BELOW)
        hidden = f"; {len(checks) - len(shown)} more, ↑ ↓" if len(shown) < len(checks) else ""
        checking = any(isinstance(request, Connect | Fix | Preflight) for request in self.state.asked)
        old, counted = checking and bool(checks), count_line(checks)
        if checking:
            counted = "Checking again; the results below are from before" if old else "Checking"
        rows.add(f" {counted}{hidden}", style=f"bold {palette.ink}")
        name = 12 if width < 110 else 20
        for n in shown:
            check = checks[n]
            sign, word = labels.CHECKS[check.state]
            line = cells(
                (f"{sign} {word}", check.name.replace("_", " "), check.seen), (11, name, width - name - 18)
            )
            line = f" {'▶' if n == chosen else ' '} {line}"
            if n == chosen:
                rows.filled(line, palette.inverse)
            else:
                first, rest = (
                    (palette.quiet, palette.quiet) if old else (f"bold {_style(check, palette)}", palette.ink)
                )
                rows.add((line[:14], first), (line[14:], rest))
        rows.down_to(height - _BELOW)
        if self.check is not None:
            _about(rows, self.check)
        return rows.text()

    def action_choose(self, step: int) -> None:
        if count := len(self.state.checks):
            self.chosen = (self.index + step) % count
            self.redraw()

    def action_look(self) -> None:
        self.chosen = None
        self.session.ask(Preflight())

    def action_fix(self) -> None:
        check = self.check
        if check is None or check.remedy is None or check.remedy.by_hand:
            return
        if not check.remedy.reboot:
            self.session.ask(Fix(check.name))
            return
        question = f"{check.remedy.words}\n\nThis reboots the rover. It must stand still and be disarmed."
        self.app.push_screen(Question(question, "fix it and reboot the rover"), self._answered(check.name))

    def _answered(self, name: str):  # type: ignore[no-untyped-def]
        def answer(yes: bool | None) -> None:
            if yes:
                self.session.ask(Fix(name, reboot=True))

        return answer

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action == "fix":
            remedy = self.check.remedy if self.check else None
            return remedy is not None and not remedy.by_hand and not self.state.busy
        return action != "look" or (self.state.vehicle is not None and not self.state.busy)


def count_line(checks: tuple[Check, ...]) -> str:
    """Sentence with the number of checks in each state."""
    if not checks:
        return "Not checked yet. In view 1, ENTER connects and runs the checks."
    bad = sum(check.state == "bad" for check in checks)
    other = sum(check.state in ("doubtful", "unknown") for check in checks)
    if not bad and not other:
        return f"All {len(checks)} checks are good: press 3 to plan the runs"
    return f"{bad} bad, {other} doubtful or unknown, {len(checks) - bad - other} good"


def _style(check: Check, palette: Palette) -> str:
    return {"good": palette.good, "doubtful": palette.doubtful, "bad": palette.bad}.get(
        check.state, palette.ink
    )


def _about(rows: ScreenRows, check: Check) -> None:
    palette = rows.palette
    rows.add("─" * rows.width, style=palette.quiet)
    rows.sentence(check.sentence or f"{check.name.replace('_', ' ')}: {check.seen}", palette.ink, most=2)
    if check.remedy is None:
        return
    if check.remedy.by_hand:
        rows.sentence(f"BY HAND: {check.remedy.words}", f"bold {palette.accent}", most=3)
        return
    after = " (reboots the rover; asks first)" if check.remedy.reboot else ""
    rows.sentence(f"F: {check.remedy.words}{after}", f"bold {palette.accent}", most=3)
