"""Choice of the connection: from the command line, remembered, serial ports."""

from __future__ import annotations

from rich.text import Text
from textual.binding import Binding

from rover_sweep.tui.drawn.drawing import ScreenRows, window
from rover_sweep.tui.model.setup import Setup
from rover_sweep.tui.screens.session_screen import SessionScreen
from rover_sweep.tui.screens.typing import Typing


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
            if n == self.chosen:
                rows.filled(line, self.palette.inverse)
            else:
                rows.add(line, style=self.palette.ink)
        rows.blank()
        if self.state.vehicle is not None:
            vehicle = self.state.vehicle
            rows.sentence(f"Connected: {vehicle.words} on {self.state.url}", f"bold {self.palette.good}")
        elif self.state.busy:
            rows.sentence("Connecting ...", f"bold {self.palette.accent}")
        elif len(self.state.failure) + 3 > width:  # too long for the message row below
            rows.sentence(f"✗ {self.state.failure}", f"bold {self.palette.bad}", most=3)
        if self.state.played is not None:
            rows.sentence("This is a recording: its rover cannot be controlled.", self.palette.ink)
            return rows.text()
        rows.sentence(_may(self.session.setup.own_part), self.palette.ink)
        rows.sentence(_folder(self.session.setup), self.palette.ink)
        return rows.text()

    def action_choose(self, step: int) -> None:
        self.chosen = (self.chosen + step) % len(self.session.places)
        self.redraw()

    def action_connect(self) -> None:
        place = self.session.places[self.chosen]
        self.session.connect(place.url, place.system)

    def action_look(self) -> None:
        self.session.look_for_ports()
        self.chosen = 0
        self.redraw()

    def action_type_url(self) -> None:
        hint = "tcp:HOST:PORT, udp:HOST:PORT (listen), udpout:HOST:PORT, or /dev/ttyACM0,115200"
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


def _folder(setup: Setup) -> str:
    """Sentence on the folder of the recordings and its earlier runs."""
    if setup.folder is None:
        return "No folder for recordings is given."
    if not setup.driven:
        return f"Recordings go to {setup.folder}."
    count = f"{len(setup.driven)} runs" if len(setup.driven) > 1 else "1 run"
    return f"Recordings go to {setup.folder}, which has {count}: that session is continued."


def _may(own: tuple[str, ...]) -> str:
    """Sentence on what the command line allows this program to do."""
    if own:
        return f"As the command line allows, this program {', '.join(own)}; it asks before each run."
    return "This program records and writes parameters; the pilot arms, drives and throws the switch."
