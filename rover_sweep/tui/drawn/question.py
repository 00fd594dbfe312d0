"""A question before something that moves or reboots the rover, answered by one key."""

from __future__ import annotations

from textual import events
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Static

from rover_sweep.files.printable import printable_lines

LEAST = 40  # columns of a question that can be read
YES = "y"  # not SPACE or ENTER, which are easily pressed by mistake


class Question(ModalScreen[bool]):
    """Y is yes; every other key is no. So is Y in a window that is too small to show the whole question."""

    CSS = """
    Question { align: center middle; background: $background; }
    Question > Vertical { width: 72; max-width: 100%; height: auto; border: heavy $foreground; padding: 1 2; }
    Question Static { width: 100%; }
    Question #yes { text-style: bold reverse; margin-top: 1; }
    """

    def __init__(self, question: str, yes: str) -> None:
        super().__init__()
        self._question, self._yes = printable_lines(question), printable_lines(yes)

    def compose(self) -> ComposeResult:
        with Vertical():
            yield Static(self._question, markup=False)
            yield Static(f" Y  {self._yes}", id="yes", markup=False)
            yield Static(" any other key: no, nothing happens", markup=False)

    def on_key(self, event: events.Key) -> None:
        event.stop()
        box = self.query_one(Vertical).region
        self.dismiss(event.key.lower() == YES and box in self.region and box.width >= LEAST)
