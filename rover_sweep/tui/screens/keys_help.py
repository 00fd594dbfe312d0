"""The keys of a view and what they do, how to stop first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Static

from rover_sweep.tui.drawn.drawing import ScreenRows

if TYPE_CHECKING:
    from rover_sweep.tui.drawn.palette import Palette

_WIDTH = 66
_STOPS = (
    "SPACE or ESC ends a run at once, from every view.",
    "Without this laptop: switch low, disarm, or change the mode; 3\N{NO-BREAK SPACE}s without this "
    "program end it too.",
)


class KeysHelp(ModalScreen[None]):
    """Scrolled by the arrow keys; any other key closes it, and does nothing else."""

    BINDINGS: ClassVar = [
        Binding("up", "scroll(-1)", show=False),
        Binding("down", "scroll(1)", show=False),
        Binding("pageup", "scroll(-10)", show=False),
        Binding("pagedown", "scroll(10)", show=False),
    ]
    CSS = """
    KeysHelp { align: center middle; background: $background; }
    KeysHelp > Vertical { width: 72; max-width: 100%; height: 100%; border: heavy $foreground; padding: 0 2; }
    KeysHelp VerticalScroll { scrollbar-size-vertical: 1; }
    KeysHelp Static { width: 100%; height: auto; }
    """

    def __init__(self, palette: Palette, view: str, about: str, keys: Sequence[tuple[str, str]]) -> None:
        super().__init__()
        self._palette, self._view, self._about, self._keys = palette, view, about, tuple(keys)

    def compose(self) -> ComposeResult:
        with Vertical(), VerticalScroll(can_focus=False):
            yield Static(self.picture(), id="help", markup=False)

    def picture(self) -> Text:
        """The content."""
        palette = self._palette
        rows = ScreenRows(palette, _WIDTH, 99)
        rows.add(" To stop", style=f"bold {palette.bad}")
        for sentence in _STOPS:
            rows.sentence(sentence, f"bold {palette.ink}", indent=2)
        rows.blank().add(f" Keys of {self._view}", style=f"bold {palette.accent}")
        if self._about:
            rows.sentence(self._about, palette.ink, indent=2)
        for key, what in self._lines():
            rows.add((f"  {key:<14}", f"bold {palette.ink}"), (what, palette.ink))
        rows.blank().add(" any key closes this; up and down scroll", style=palette.quiet)
        return rows.text()

    def _lines(self) -> Iterator[tuple[str, str]]:
        yield from self._keys
        yield "^P", "all commands, found by their names"

    def action_scroll(self, step: int) -> None:
        self.query_one(VerticalScroll).scroll_relative(y=step, animate=False)

    def on_key(self, event: object) -> None:
        from textual import events

        if isinstance(event, events.Key) and event.key not in ("up", "down", "pageup", "pagedown"):
            event.stop()
            self.dismiss(None)
