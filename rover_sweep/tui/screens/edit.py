"""Edit the numbers of one row by arrow keys or digits; refuses what the applet would refuse."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rich.text import Text
from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Static

from rover_sweep.errors import UsageError
from rover_sweep.tui.drawn.drawing import ScreenRows
from rover_sweep.tui.model.plan_rows import Field, Row, fields, row_with, value
from rover_sweep.tui.screens.frame import ABORT_WORDS

if TYPE_CHECKING:
    from rover_sweep.tui.drawn.palette import Palette

_WIDTH = 62


class EditRow(ModalScreen[Row | None]):
    """ENTER returns the changed row, ESC None."""

    BINDINGS = [
        Binding("enter", "keep", "save", priority=True),
        Binding("escape,q", "leave", "cancel"),
        Binding("up", "choose(-1)", "choose"),
        Binding("down", "choose(1)", "choose"),
        Binding("left", "step(-1)", "less"),
        Binding("right", "step(1)", "more"),
        Binding("backspace", "rub_out", "delete"),
    ]
    CSS = """
    EditRow { align: center middle; background: $background; }
    EditRow > Vertical { width: 68; max-width: 100%; height: auto; border: heavy $foreground; padding: 1 2; }
    EditRow Static { width: 100%; height: auto; }
    """

    def __init__(self, row: Row, limits: Mapping[str, float]) -> None:
        super().__init__()
        self.row, self._limits = row, limits
        self.chosen, self._typed, self._refusal = 0, "", ""

    def compose(self) -> ComposeResult:
        with Vertical():
            yield Static(id="fields", markup=False)

    def on_mount(self) -> None:
        self.redraw()

    def redraw(self) -> None:
        """Draw all fields."""
        from rover_sweep.tui.session_app import SessionApp

        assert isinstance(self.app, SessionApp)
        for shown in self.query("#fields").results(Static):
            shown.update(self.picture(self.app.palette, self.app.state.under_way))

    def picture(self, palette: Palette, under_way: bool) -> Text:
        """The content. under_way: a run is in progress, and ESC aborts it."""
        rows = ScreenRows(palette, _WIDTH, 30)
        rows.add(f" {self.row.kind}", style=f"bold {palette.ink}").blank()
        for n, field in enumerate(fields(self.row)):
            shown = f"{value(self.row, field):{field.form}}"
            if n == self.chosen and self._typed:
                shown = self._typed + "_"
            line = f" {'▶' if n == self.chosen else ' '} {field.words:<22}{shown:>10} {field.unit}"
            if n == self.chosen:
                rows.filled(line, palette.inverse)
            else:
                rows.add(line, style=palette.ink)
        rows.blank().sentence(
            self._refusal or f"{self.row.manoeuvre.duration:.0f} s of steering",
            f"bold {palette.bad}" if self._refusal else palette.ink,
            most=3,
        )
        rows.blank().sentence("↑ ↓ choose   ← → less, more   or type the number", palette.ink)
        rows.sentence(f"ENTER saves   {'Q' if under_way else 'ESC'} cancels", palette.ink)
        if under_way:
            rows.blank().filled(f" RUN IN PROGRESS - {ABORT_WORDS} ABORTS", palette.alarming)
        return rows.text()

    @property
    def field(self) -> Field:
        return fields(self.row)[self.chosen]

    def action_choose(self, step: int) -> None:
        if self._take_typed():
            self.chosen = (self.chosen + step) % len(fields(self.row))
        self.redraw()

    def action_step(self, direction: int) -> None:
        if self._take_typed():
            self._change(value(self.row, self.field) + direction * self.field.step)
        self.redraw()

    def action_rub_out(self) -> None:
        self._typed = self._typed[:-1]
        self.redraw()

    def action_keep(self) -> None:
        if self._take_typed():
            self.dismiss(self.row)
        else:
            self.redraw()

    def action_leave(self) -> None:
        self.dismiss(None)

    def on_key(self, event: events.Key) -> None:
        if event.character and event.character in "0123456789.-":
            event.stop()
            self._typed = (self._typed + event.character)[:8]
            self._refusal = ""
            self.redraw()

    def _take_typed(self) -> bool:
        """Set the field to the typed number; False, with the reason shown, if it is refused."""
        if not self._typed:
            return True
        typed, self._typed = self._typed, ""
        try:
            number = float(typed)
        except ValueError:
            self._refusal = f"{typed!r} is not a number"
            return False
        return self._change(number)

    def _change(self, number: float) -> bool:
        try:
            self.row, self._refusal = row_with(self.row, self.field, number, self._limits), ""
        except UsageError as error:
            self._refusal = str(error)
        return not self._refusal
