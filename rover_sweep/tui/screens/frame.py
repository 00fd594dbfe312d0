"""The frame of all screens: views, state of the rover, last message, keys."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual import events
from textual.actions import parse as parse_action
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical, VerticalScroll
from textual.screen import Screen
from textual.widgets import Static

from rover_sweep.live.source import Connect, DriveRequest, FetchLogs, Fix, Play, Preflight, Request
from rover_sweep.tui import drawn as labels
from rover_sweep.tui.drawn import Box, Palette, ScreenRows, cut_line, harmless, in_rows
from rover_sweep.tui.model.plan_rows import task
from rover_sweep.tui.model.state import State

if TYPE_CHECKING:
    from rover_sweep.tui.session_app import SessionApp

VIEWS = ("connect", "preflight", "plan", "run", "verdict", "log", "results")
LEAST = (72, 20)  # columns, rows
_LONG = 5.0  # s after which the elapsed time of a request is shown
ABORT_WORDS = "SPACE or ESC"
LEVELS = {"info": "", "vehicle": "rover: ", "warning": "WARNING: ", "error": "ERROR: "}


def tabs(view: str, palette: Palette, width: int) -> Text:
    """The views with their digits; the current one in brackets and inverse."""
    text = Text(" ", no_wrap=True)
    for digit, name in enumerate(VIEWS, 1):
        here = name == view
        text.append(
            f"[{digit} {name.upper()}]" if here else f" {digit} {name} ", palette.inverse if here else ""
        )
    text.truncate(width)
    return text


def status(state: State, palette: Palette, width: int) -> Text:
    """Link, arming, mode, switch, battery, GPS and recording in one row."""
    link, style = _link(state, palette)
    now = state.snapshot
    text = Text(f" {link}", style=f"bold {style}", no_wrap=True)
    if now is None:
        return text
    if state.lost:
        text.append("  last heard:", palette.ink)
    armed = ("  ARMED ", palette.alarming) if now.armed else ("  disarmed ", palette.ink)
    text.append(*armed)
    text.append(f" {labels.mode_label(now.mode)}  switch {labels.switch_label(now.switch)}", palette.ink)
    volts = f"{now.volts:.1f} V " if math.isfinite(now.volts) else ""
    remaining = f"{100 * now.remaining:.0f} %" if math.isfinite(now.remaining) else ""
    parts = [
        f"{volts}{remaining}".rstrip(),
        f"{labels.FIXES.get(now.fix, 'GPS ?')} {now.satellites}",
        "EKF ok" if now.ekf else "EKF not ready",
        f"{now.received:.0f} messages/s" if math.isfinite(now.received) else "",
        f"recorded {labels.size(now.recorded)}",
    ]
    for part in parts if width >= 110 else parts[:3]:
        if part and text.cell_len + len(part) + 2 <= width:
            text.append(f"  {part}", palette.ink)
    return text


def _link(state: State, palette: Palette) -> tuple[str, str]:
    if state.played is not None:
        played = state.played
        pace = "PAUSED" if played.rate == 0 else f"x{played.rate:g}"
        t, length = (f"{int(s) // 60}:{int(s) % 60:02d}" for s in (played.t, played.length))
        return f"▶ REPLAY {t} of {length} {pace}", palette.accent
    if state.lost:
        return "✗ LINK LOST", palette.bad
    if state.vehicle is not None:
        return "● LINK", palette.good
    return "○ no link", palette.quiet


def message(
    state: State,
    palette: Palette,
    width: int,
    last: bool = True,
    waited: float = 0.0,
    hint: str = "",
    most: int = 1,
) -> Text:
    """During a run, how to abort it; else the pending request and its time `waited` [s]; else the failure;
    else, with `last`, the last line of the log. In at most `most` rows.

    hint: why the key that was pressed last does nothing.
    """
    if state.aborting:
        return Text(" ABORTING - releasing the rover ".center(width), palette.alarming, no_wrap=True)
    if state.under_way:
        words = f" RUN IN PROGRESS - {ABORT_WORDS} ABORTS{' - ' if hint else ''}{hint} "
        return Text(words.center(width), palette.alarming, no_wrap=True)
    if hint:
        return Text(cut_line(f" {hint}", width), f"bold {palette.accent}", no_wrap=True)
    if state.asked:
        since = f"{waited:.0f} s " if waited >= _LONG else ""
        work = since + ": ".join(filter(None, (working_on(state.asked[0]), state.doing)))
        return Text(cut_line(f" … {work}", width), f"bold {palette.accent}", no_wrap=True)
    if state.failure:
        words = in_rows(f"✗ {state.failure}", width, most)
        return Text(words, f"bold {palette.bad}", no_wrap=True)
    if not (state.messages and last):
        return Text("")
    line = state.messages[-1]
    style = {"warning": palette.doubtful, "error": palette.bad}.get(line.level, palette.quiet)
    return Text(in_rows(f"{LEVELS[line.level]}{line.text}", width, most), style, no_wrap=True)


def working_on(request: Request) -> str:
    """The pending request in words."""
    match request:
        case Connect():
            return f"connecting to {request.url}"
        case Preflight():
            return "running the checks"
        case Fix():
            return f"fixing: {request.name.replace('_', ' ')}"
        case DriveRequest():
            return f"driving {request.planned.name}"
        case FetchLogs():
            return "fetching the logs"
        case Play():
            return "playing"


def keys(bindings: Sequence[tuple[str, str]], palette: Palette, width: int) -> Text:
    """The active keys, in at most two rows."""
    rows, room = [Text(" ", no_wrap=True)], width - 1
    for key, what in bindings:
        need = len(key) + len(what) + 5
        if room < need:
            if len(rows) == 2:
                break
            rows.append(Text(" ", no_wrap=True))
            room = width - 1
        rows[-1].append(f" {key} ", palette.inverse).append(f" {what}  ", palette.ink)
        room -= need
    return Text("\n").join(rows)


def is_small(width: int, height: int) -> bool:
    """True for a window that cannot show a view."""
    return width < LEAST[0] or height < LEAST[1]


# The keys of a view and what they do, how to stop first.


_WIDTH = 66
_STOPS = (
    "SPACE or ESC ends a run at once, from every view.",
    "Without this laptop: switch low, disarm, or change the mode; 3\N{NO-BREAK SPACE}s without this "
    "program end it too.",
)


class KeysHelp(Box[None]):
    """Scrolled by the arrow keys; any other key closes it, and does nothing else."""

    CSS = """
    KeysHelp > Vertical { height: 100%; padding: 0 2; }
    KeysHelp VerticalScroll { scrollbar-size-vertical: 1; }
    """

    def __init__(self, palette: Palette, view: str, about: str, keys: Sequence[tuple[str, str]]) -> None:
        super().__init__()
        self._palette, self._view, self._about, self._keys = palette, view, about, tuple(keys)

    def compose(self) -> ComposeResult:
        with Vertical(), VerticalScroll():
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
        for key, what in (*self._keys, ("^P", "all commands, found by their names")):
            rows.add((f"  {key:<14}", f"bold {palette.ink}"), (what, palette.ink))
        rows.blank().add(" any key closes this; up and down scroll", style=palette.quiet)
        return rows.text()

    def on_key(self, event: events.Key) -> None:
        if event.key not in ("up", "down", "pageup", "pagedown"):
            event.stop()
            self.dismiss(None)


# A screen of the session, drawn from the state; redrawn when state or window change.


_AROUND = 5  # rows: views, status, message, keys
_MESSAGE = 4  # rows of the longest message
_OF_A_ROVER = ("go", "look", "fix", "fetch")  # actions that need one
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
        self._refused: Binding | None = None  # of the key pressed last, if it did nothing

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
        self._refused = None
        self.redraw()

    def on_key(self, event: events.Key) -> None:
        """A capital letter is its key: the screen shows keys as capitals, and Caps Lock may be on."""
        if len(event.key) == 1 and event.key != event.key.lower():
            event.stop()
            self.app.simulate_key(event.key.lower())
            return
        before, self._refused = self._refused, None
        for binding in self._bindings.key_to_bindings.get(event.key, ()):
            if not self.check_action(*parse_action(binding.action)[1:]):
                self._refused = binding
        if self._refused is not before:
            self.redraw()

    @property
    def _hint(self) -> str:
        """Why the key that was pressed last does nothing; "" if it does something, or now would."""
        binding = self._refused
        if binding is None or self.check_action(*parse_action(binding.action)[1:]):
            return ""
        why = self.why_not(parse_action(binding.action)[1])
        return f"{_key(binding)}: {why}" if why else ""

    def why_not(self, action: str) -> str:
        """Why the key of this action does nothing now, as a phrase; "" if the view shows it."""
        state = self.state
        if state.under_way:
            return "not during a run"
        if state.asked:
            return f"not while {working_on(state.asked[0])}"
        if action in _OF_A_ROVER and state.played is not None:
            return "this is a recording"
        if action in _OF_A_ROVER and state.vehicle is None:
            return "no rover is connected; 1 connects"
        return ""

    def action_go(self) -> None:
        self.session.drive_next()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        return action != "go" or self.session.may_drive

    def on_resize(self) -> None:
        self.redraw()

    def redraw(self) -> None:
        """Draw all parts."""
        if not self.is_mounted:
            return
        width, height = self.size
        small = is_small(width, height)
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
            yield "body", self._too_small(width, height)
            return
        body = self._drawn(width, height - _AROUND)
        most = min(_MESSAGE, 1 + height - LEAST[1])
        last = self.state.messages[-1].level if self.state.messages and self.repeats_messages else ""
        if not (self.state.failure or last in ("warning", "error")):  # else free rows only
            most = min(most, 1 + height - _AROUND - len(body.plain.rstrip().split("\n")))
        waited = self.session.waited
        said = message(self.state, self.palette, width, self.repeats_messages, waited, self._hint, most)
        rows = said.plain.count("\n") + 1
        self.query_one("#message").styles.height = rows
        yield "tabs", tabs(self.view, self.palette, width)
        yield "status", status(self.state, self.palette, width)
        yield "body", body if rows == 1 else self._drawn(width, height - _AROUND + 1 - rows)
        yield "message", said
        yield "keys", keys(list(self.keys_now()), self.palette, width)

    def _too_small(self, width: int, height: int) -> Text:
        """During a run with the pilot's task and the abort keys."""
        rows, ink = ScreenRows(self.palette, width, height), self.palette.ink
        if self.state.under_way:
            rows.filled(f" {ABORT_WORDS} ABORTS", self.palette.alarming)
            now = task(self.state)
            rows.sentence(f"{now.big}: {now.sentence}", f"bold {ink}", most=4)
        rows.sentence(f"The window is {width}x{height}; make it {LEAST[0]}x{LEAST[1]} or larger.", ink)
        return rows.text()

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
