"""Edit the numbers of one row by arrow keys or digits; refuses what the applet would refuse."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rich.text import Text
from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Vertical
from textual.widgets import Input, Static

from rover_sweep.errors import UsageError
from rover_sweep.live.source import FetchLogs
from rover_sweep.tui import drawn as labels
from rover_sweep.tui.drawn import Box, ScreenRows, bar, cells, moved, window, wrapped
from rover_sweep.tui.model.plan_rows import Field, Row, fields, row_with, value
from rover_sweep.tui.model.state import RunRecord
from rover_sweep.tui.screens.frame import ABORT_WORDS, LEVELS, SessionScreen
from rover_sweep.tui.screens.run import verdict_sentence

if TYPE_CHECKING:
    from rover_sweep.tui.drawn import Palette

_WIDTH = 62


class EditRow(Box[Row | None]):
    """ENTER returns the changed row, ESC None."""

    BINDINGS = [
        Binding("enter", "keep", "save", priority=True),
        Binding("escape,q", "dismiss", "cancel"),
        Binding("up", "choose(-1)", "choose"),
        Binding("down", "choose(1)", "choose"),
        Binding("left", "step(-1)", "less"),
        Binding("right", "step(1)", "more"),
        Binding("backspace", "rub_out", "delete"),
    ]

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
            rows.listed(line, n == self.chosen)
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
            self.chosen = moved(self.chosen, step, len(fields(self.row)))
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


# A box that asks for a line of text.


class Typing(Box[str | None]):
    """ENTER returns the text, ESC None."""

    BINDINGS = [Binding("escape", "dismiss", "cancel")]
    CSS = """
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


# All runs of the session with outcome and verdict, and the messages of rover and program.


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
        lines = [
            (row, {"warning": palette.doubtful, "error": f"bold {palette.bad}"}.get(line.level, palette.ink))
            for line in state.messages
            for row in wrapped(f"{LEVELS[line.level]}{line.text}", width - 2)
        ]
        most = max(height // 2 - 2, height - 5 - len(lines))
        listed = [run_lines(run, width - 2) for run in state.runs[-most:]]
        whole = sum(map(len, listed)) <= most
        for run, of_run in zip(state.runs[-most:], listed, strict=True):
            for line in of_run if whole else run_lines(run, width - 2, whole):
                rows.add(f" {line}", style=palette.ink)
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
        end = len(lines) - min(self.back, max(0, len(lines) - rows.left))
        for row, style in lines[max(0, end - rows.left) : end]:
            rows.add(f" {row}", style=style)
        return rows.text()

    def action_fetch(self) -> None:
        self.session.ask(FetchLogs())

    def action_scroll(self, step: int) -> None:
        self.back = min(max(0, self.back + step), max(0, len(self.state.messages) - 1))
        self.redraw()

    def why_not(self, action: str) -> str:
        waits = "" if action != "fetch" or not self.state.armed else "not while the rover is armed"
        return super().why_not(action) or waits

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action != "fetch":
            return True
        state = self.state
        ready = state.vehicle is not None and state.played is None
        return ready and not state.busy and not state.armed


_RUN = (13, 11, 8)  # columns of a run in the log: name, outcome, amplitude


def run_lines(run: RunRecord, width: int, whole: bool = True) -> list[str]:
    """A run with its outcome and verdict, in as many lines as the verdict needs; not whole: in one line."""
    first = run.label, " ".join(labels.OUTCOMES[run.outcome]), f"±{run.manoeuvre.amplitude:g} us"
    result, left = run.reason, sum(_RUN) + len(_RUN)
    if run.verdict is not None:
        result = f"{labels.ADVICE[run.verdict.advice][0]} {verdict_sentence(run.verdict)}"
    if not whole:
        return [cells((*first, result), (*_RUN, width - left - 1))]
    words = wrapped(result, width - left - 1) or [""]
    head = (cells(first, _RUN), *([" " * (left - 1)] * (len(words) - 1)))
    return [f"{start} {row}".rstrip() for start, row in zip(head, words, strict=True)]


# Choice of the connection: from the command line, remembered, serial ports.


class ConnectScreen(SessionScreen):
    """ENTER connects and runs the preflight checks, which change nothing."""

    view = "connect"
    repeats_messages = False
    BINDINGS = [
        Binding("enter", "connect", "connect"),
        Binding("up", "choose(-1)", "choose"),
        Binding("down", "choose(1)", "choose"),
        Binding("u", "type_url", "type another"),
        Binding("r", "look", "look for ports"),
    ]
    chosen = 0

    def picture(self, width: int, height: int) -> Text:
        rows = ScreenRows(self.palette, width, height).blank()
        rows.add(" Which rover?", style=f"bold {self.palette.ink}").blank()
        found = self.session.places
        for n in window(len(found), self.chosen, height - 9):
            mark = "▶" if n == self.chosen else " "
            line = f" {mark} {found[n].url:<46.46} {found[n].origin}"
            rows.listed(line, n == self.chosen)
        rows.blank()
        if self.state.vehicle is not None:
            vehicle = self.state.vehicle
            rows.sentence(f"Connected: {vehicle.words} on {self.state.url}", f"bold {self.palette.good}")
        elif self.state.busy:
            rows.sentence("Connecting ...", f"bold {self.palette.accent}")
        if self.state.played is not None:
            rows.sentence("This is a recording: its rover cannot be controlled.", self.palette.ink)
            return rows.text()
        setup = self.session.setup
        may = "This program records and writes parameters; the pilot arms, drives and throws the switch."
        if own := ", ".join(setup.own_part):
            may = f"As the command line allows, this program {own}; it asks before each run."
        kept = f"Recordings go to {setup.folder}" if setup.folder else "No folder for recordings is given"
        if setup.folder and setup.driven:
            count = f"{len(setup.driven)} run{'s' if len(setup.driven) > 1 else ''}"
            kept += f", which has {count}: that session is continued"
        rows.sentence(may, self.palette.ink)
        rows.sentence(f"{kept}.", self.palette.ink)
        return rows.text()

    def action_choose(self, step: int) -> None:
        self.chosen = moved(self.chosen, step, len(self.session.places))
        self.redraw()

    def action_connect(self) -> None:
        place = self.session.places[self.chosen]
        self.session.connect(place.url, place.system)

    def action_look(self) -> None:
        self.session.look_for_ports()
        self.chosen = 0
        self.redraw()

    def action_type_url(self) -> None:
        hint = "tcp:HOST:PORT, udp:HOST:PORT (listen), udpout:HOST:PORT, COM5, or /dev/ttyUSB0,57600"
        self.app.push_screen(Typing("Connection:", hint, self.session.setup.url), self._typed)

    def _typed(self, url: str | None) -> None:
        if url:
            self.chosen = 0
            self.session.connect(url)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action == "type_url":
            return not (self.state.under_way or self.state.played is not None)
        played = self.state.played is not None
        return action != "connect" or not (self.state.busy or self.state.under_way or played)
