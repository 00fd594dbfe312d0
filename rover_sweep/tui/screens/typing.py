"""A box that asks for a line of text."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static


class Typing(ModalScreen[str | None]):
    """ENTER returns the text, ESC None."""

    BINDINGS = [Binding("escape", "leave", "cancel")]
    CSS = """
    Typing { align: center middle; background: $background; }
    Typing > Vertical { width: 76; max-width: 100%; height: auto; border: heavy $foreground; padding: 1 2; }
    Typing Input { border: tall $foreground; color: $foreground; background: $background; }
    Typing Input > .input--cursor { color: $background; background: $foreground; text-style: none; }
    Typing Input > .input--selection { color: $background; background: $foreground; }
    """

    def __init__(self, question: str, hint: str, value: str = "") -> None:
        super().__init__()
        self._question, self._hint, self._value = question, hint, value

    def compose(self) -> ComposeResult:
        with Vertical():
            yield Static(self._question, markup=False)
            yield Input(self._value)
            yield Static(f"{self._hint}\n\nENTER accepts, ESC cancels", markup=False)

    def on_mount(self) -> None:
        self.query_one(Input).focus()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        self.dismiss(event.value.strip())

    def action_leave(self) -> None:
        self.dismiss(None)
