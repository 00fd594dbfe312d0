"""A screen of the session, drawn from the state; redrawn when state or window change."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.screen import Screen
from textual.widgets import Static

from rover_sweep.tui.drawn.drawing import ScreenRows, harmless
from rover_sweep.tui.model.pilot import task
from rover_sweep.tui.screens import frame

if TYPE_CHECKING:
    from rover_sweep.tui.drawn.palette import Palette
    from rover_sweep.tui.model.state import State
    from rover_sweep.tui.session_app import SessionApp

_AROUND = 5  # rows: views, status, message, keys
_NAMES = {
    "up": "↑",
    "down": "↓",
    "left": "←",
    "right": "→",
    "enter": "ENTER",
    "space": "SPACE",
    "escape": "ESC",
    "plus": "+",
    "minus": "-",
    "tab": "TAB",
    "pageup": "PGUP",
    "pagedown": "PGDN",
}


class SessionScreen(Screen[None]):
    """`view`: its name; `picture`: the content between status and message. `repeats_messages`: show the last
    line of the log below."""

    view: ClassVar[str] = ""
    repeats_messages: ClassVar[bool] = True
    DEFAULT_CSS = """
    SessionScreen { layout: vertical; overflow: hidden hidden; }
    SessionScreen Static { width: 100%; text-wrap: nowrap; text-overflow: clip; }
    SessionScreen .row { height: 1; }
    SessionScreen #body { height: 1fr; }
    SessionScreen #keys { height: 2; }
    """

    def __init__(self) -> None:
        super().__init__()
        self._shown: dict[str, Text] = {}  # by place

    @property
    def session(self) -> SessionApp:
        """The application, with its type."""
        from rover_sweep.tui.session_app import SessionApp

        assert isinstance(self.app, SessionApp)
        return self.app

    @property
    def state(self) -> State:
        return self.session.state

    @property
    def palette(self) -> Palette:
        return self.session.palette

    @abstractmethod
    def picture(self, width: int, height: int) -> Text:
        """The content, width columns by height rows."""

    def compose(self) -> ComposeResult:
        yield Static(id="tabs", classes="row", markup=False)
        yield Static(id="status", classes="row", markup=False)
        yield Static(id="body", markup=False)
        yield Static(id="message", classes="row", markup=False)
        yield Static(id="keys", markup=False)

    def on_mount(self) -> None:
        self.redraw()

    def on_screen_resume(self) -> None:
        self.redraw()

    def on_key(self, event: events.Key) -> None:
        """A capital letter is its key: the screen shows keys as capitals, and Caps Lock may be on."""
        if len(event.key) == 1 and event.key != event.key.lower():
            event.stop()
            self.app.simulate_key(event.key.lower())

    def on_resize(self) -> None:
        self.redraw()

    def redraw(self) -> None:
        """Draw all parts."""
        if not self.is_mounted:
            return
        width, height = self.size
        small = frame.is_small(width, height)
        for name in ("tabs", "status", "message", "keys"):
            self.query_one(f"#{name}").display = not small
        for name, picture in self._pictures(width, height, small):
            shown = self._shown.get(name, Text())
            if shown != picture or shown.style != picture.style:  # laying out again is dear
                self._shown[name] = harmless(picture)
                self.query_one(f"#{name}", Static).update(picture)

    def _pictures(self, width: int, height: int, small: bool) -> Iterator[tuple[str, Text]]:
        """(place, content) of all parts."""
        if small:
            yield "body", frame.too_small(self.state, task(self.state), self.palette, width, height)
            return
        waited = self.session.waited
        yield "tabs", frame.tabs(self.view, self.palette, width)
        yield "status", frame.status(self.state, self.palette, width)
        yield "body", self._drawn(width, height - _AROUND)
        yield "message", frame.message(self.state, self.palette, width, self.repeats_messages, waited)
        yield "keys", frame.keys(list(self.keys_now()), self.palette, width)

    def _drawn(self, width: int, height: int) -> Text:
        """The content, or a sentence on an exception: the program must keep running during a run."""
        try:
            return self.picture(width, height)
        except Exception as error:
            words = f"This view cannot be drawn ({error!r}); other views and SPACE to abort still work."
            return ScreenRows(self.palette, width, height).sentence(words, f"bold {self.palette.bad}").text()

    def keys_now(self) -> Iterator[tuple[str, str]]:
        """(key, action) of all active keys, priority keys first; keys of the same action together."""
        actions: dict[str, tuple[list[str], Binding]] = {}
        for active in self.active_bindings.values():
            binding = active.binding
            if binding.show and active.enabled:
                actions.setdefault(binding.description, ([], binding))[0].append(_key(binding))
        ordered = sorted(actions.items(), key=lambda item: not item[1][1].priority)
        for what, (names, _) in ordered:
            yield "/".join(dict.fromkeys(names)), what


def _key(binding: Binding) -> str:
    if binding.key_display:
        return binding.key_display
    return _NAMES.get(binding.key, binding.key.upper())
