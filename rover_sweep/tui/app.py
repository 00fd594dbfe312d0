"""The application: seven views of a session, controlled by keys. SPACE and ESC end a run from every view.

Without this laptop, switch low, disarming, a mode change, or 3 s without our override end a run.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

from textual.actions import ActionParseResult
from textual.actions import parse as parse_action
from textual.app import SystemCommand
from textual.binding import Binding
from textual.dom import DOMNode
from textual.screen import Screen
from textual.theme import Theme

from rover_sweep.errors import UsageError
from rover_sweep.live.source import Play, Played, Source
from rover_sweep.system import STOP_SIGNALS, end_with_parent
from rover_sweep.tui.drawn import DARK, LIGHT
from rover_sweep.tui.model.setup import Memory, Setup, remember
from rover_sweep.tui.model.state import AbortAsked, reduce
from rover_sweep.tui.screens import frame
from rover_sweep.tui.screens.edit import ConnectScreen, EditRow, LogScreen
from rover_sweep.tui.screens.frame import KeysHelp, SessionScreen
from rover_sweep.tui.screens.plan import PlanScreen, PreflightScreen
from rover_sweep.tui.screens.results import ResultsScreen
from rover_sweep.tui.screens.run import RunScreen, VerdictScreen
from rover_sweep.tui.session_app import SessionApp
from rover_sweep.vehicle.events import Notice

# The command palette: every key of the view on top, found by what it does.


DRIVES = "go"
ARROWS = ("up", "down", "left", "right")


_SCREENS = (ConnectScreen, PreflightScreen, PlanScreen, RunScreen, VerdictScreen, LogScreen, ResultsScreen)
_SEEK, _SLOWEST, _FASTEST = 10.0, 0.125, 64.0  # s per key; times real time


BLIND = ("abort", "leave")  # actions that are safe where the window shows nothing


class SweepApp(SessionApp):
    """The views and the keys that work in all of them."""

    TITLE = "rover-sweep"
    COMMAND_PALETTE_BINDING = "ctrl+p"
    CSS = """
    Screen { background: $background; color: $foreground; }
    Static { color: $foreground; }
    """
    BINDINGS: ClassVar = [
        Binding("space", "abort", "ABORT", priority=True),
        Binding("escape", "abort", "ABORT", priority=True),
        *(
            Binding(str(n), f"view('{name}')", "views", key_display="1-7")
            for n, name in enumerate(frame.VIEWS, 1)
        ),
        Binding("tab", "turn(1)", show=False),
        Binding("shift+tab", "turn(-1)", show=False),
        Binding("space", "pause", "pause"),
        Binding("comma", "seek(-1)", "10 s back", key_display=","),
        Binding("full_stop", "seek(1)", "10 s forward", key_display="."),
        Binding("minus", "pace(0.5)", "slower"),
        Binding("plus,equals_sign", "pace(2.0)", "faster", key_display="+"),
        Binding("question_mark", "keys_help", "help", key_display="?"),
        Binding("c", "colours", "dark/light"),
        Binding("q", "leave", "quit"),
        Binding("ctrl+q,ctrl+c", "leave", show=False, priority=True),
    ]

    def __init__(self, source: Source, setup: Setup, view: str = "connect") -> None:
        super().__init__(source, setup)
        self._first = view
        self._left = False
        self._loop_of_views: asyncio.AbstractEventLoop | None = None
        for palette in (LIGHT, DARK):
            ink, ground = palette.ink, palette.ground
            self.register_theme(
                Theme(
                    palette.name,
                    ink,
                    foreground=ink,
                    background=ground,
                    surface=ground,
                    panel=ground,
                    dark=palette is DARK,
                )
            )

    def get_system_commands(self, screen: Screen[Any]) -> Iterator[SystemCommand]:
        """The commands of the active keys, except driving: only its own key starts a run, not a search."""
        active = screen.active_bindings.values() if isinstance(screen, SessionScreen) else ()
        seen: set[str] = set()
        for binding, node in ((a.binding, a.node) for a in active if a.enabled and a.binding.show):
            view = binding.action.startswith("view(")
            words = "view " + binding.action.split("'")[1] if view else binding.description
            if binding.action != DRIVES and binding.key not in ARROWS and words not in seen:
                seen.add(words)
                key = binding.key if view else binding.key_display or binding.key
                act = partial(self.run_action, binding.action, node)
                yield SystemCommand(f"{words} ({key.upper()})", "", act)

    def on_mount(self) -> None:
        self.theme = self.palette.name
        for screen in _SCREENS:  # installed, as Textual would delete a view when it is replaced
            self.install_screen(screen(), screen.view)
        self.push_screen(self._first)
        self.set_interval(1.0, self._redraw_waiting)
        self._loop_of_views = asyncio.get_running_loop()
        self.source.start(self.feed.put)
        if self._left:
            self.exit()

    def leave_now(self, *_: object) -> None:
        """On a signal to end: abort first, as closing the views takes seconds. However often it comes."""
        self.source.abort()
        self._left = True
        if self._loop_of_views is not None:
            with contextlib.suppress(RuntimeError):  # the views have closed already
                self._loop_of_views.call_soon_threadsafe(self.exit)

    async def on_unmount(self) -> None:
        await self.analyses.close()

    def redraw(self) -> None:
        for screen in self.screen_stack if self.is_running else ():
            if isinstance(screen, SessionScreen | EditRow):
                screen.redraw()

    def _redraw_waiting(self) -> None:
        if self.state.busy:  # its time goes on without messages from the rover
            self.redraw()

    def turn_to(self, view: str, only_from: tuple[str, ...]) -> None:
        if isinstance(self.screen, SessionScreen) and self.screen.view in only_from:
            self.action_view(view)

    # ---- keys ------------------------------------------------------------------------------------

    async def run_action(
        self,
        action: str | ActionParseResult,
        default_namespace: DOMNode | None = None,
        namespaces: Mapping[str, DOMNode] | None = None,
    ) -> bool:
        """Report an exception of a key as a warning: the screen with ABORT must keep running.

        In a window that is too small to show what a key does, only stopping and leaving have one.
        """
        name = (parse_action(action) if isinstance(action, str) else action)[1]
        if frame.is_small(*self.size) and isinstance(self.screen, SessionScreen) and name not in BLIND:
            return True
        try:
            return await super().run_action(action, default_namespace, namespaces)
        except Exception as error:
            words = f"internal error on this key: {error!r}; other keys and ABORT still work"
            self.state = reduce(self.state, Notice("warning", words))
            return True

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action == "abort":
            return self.state.under_way
        if action in ("pause", "seek", "pace"):
            return self.state.played is not None
        if action in ("command_palette", "keys_help"):  # over a question every key but Y is no
            return isinstance(self.screen, SessionScreen)
        return True

    def action_abort(self) -> None:
        """Abort at once, without a question; redraw afterwards."""
        self.source.abort()
        self.state = reduce(self.state, AbortAsked())

    def action_view(self, view: str) -> None:
        if isinstance(self.screen, SessionScreen) and self.screen.view != view:
            self.switch_screen(view)

    def action_turn(self, step: int) -> None:
        if isinstance(self.screen, SessionScreen):
            self.action_view(frame.VIEWS[(frame.VIEWS.index(self.screen.view) + step) % len(frame.VIEWS)])

    def action_keys_help(self) -> None:
        """The keys of the view on top; not over a question, where every other key means no."""
        if isinstance(screen := self.screen, SessionScreen):
            about = (type(screen).__doc__ or "").split("\n")[0]
            self.push_screen(KeysHelp(self.palette, screen.view, about, list(screen.keys_now())))

    def action_colours(self) -> None:
        self.palette = LIGHT if self.palette is DARK else DARK
        self.theme = self.palette.name
        self.memory = Memory(self.memory.urls, self.palette is DARK)
        remember(self.setup.memory, self.memory)
        self.redraw()

    def action_leave(self) -> None:
        """During a run the first press aborts it; otherwise quit."""
        if self.state.under_way and not self.state.aborting:
            self.action_abort()
        else:
            self.exit()

    def action_pause(self) -> None:
        if (playback := self._playback) is not None:
            self._paced, rate = (playback.rate or self._paced), (self._paced if playback.rate == 0 else 0.0)
            self.ask(Play(rate=rate))

    _paced = 1.0

    @property
    def _playback(self) -> Played | None:
        """State of the playback after all pending requests, as keys may come faster than answers."""
        playback = self.state.played
        for request in self.state.asked if playback else ():
            if isinstance(request, Play) and playback is not None:
                at = playback.t if request.at is None else request.at
                rate = playback.rate if request.rate is None else request.rate
                playback = replace(playback, t=at, rate=rate)
        return playback

    def action_seek(self, direction: int) -> None:
        if (playback := self._playback) is not None:
            self.ask(Play(at=min(max(0.0, playback.t + direction * _SEEK), playback.length)))

    def action_pace(self, factor: float) -> None:
        if (playback := self._playback) is not None:
            self.ask(Play(rate=min(max(_SLOWEST, (playback.rate or self._paced) * factor), _FASTEST)))


def _close_and_die(source: Source) -> None:
    """End a run and this process, whatever the views are waiting for."""
    try:
        source.abort()
        source.close()
    finally:
        os._exit(1)


@contextlib.contextmanager
def _handled(handler: Callable[..., object]) -> Iterator[None]:
    """Within it `handler` gets the signals to end. asyncio's own handlers end with its loop."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in STOP_SIGNALS}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


def show(source: Source, setup: Setup | None = None, view: str = "connect", in_browser: bool = False) -> None:
    """Show a source until the user quits, then close it, also after an error.

    view: the first view, one of `frame.VIEWS`; 'run' for a recording. in_browser: by `SessionServer`, whose
    end ends the session. UsageError without a terminal.
    """
    if not in_browser and not (sys.stdin.isatty() and sys.stdout.isatty()):
        source.close()
        raise UsageError(
            "this draws a screen and reads keys, so it needs a terminal; without one use `rover-sweep run`"
        )
    app = SweepApp(source, setup or Setup(), view)
    if in_browser:
        end_with_parent(partial(_close_and_die, source))
    with _handled(app.leave_now):  # until the rover is released, which another signal must not end
        try:
            app.run(mouse=False)  # so that the mouse can select and copy text
        finally:
            if unreleased := source.close():
                print(f"rover-sweep: {unreleased}", file=sys.stderr)
    if app.return_code:  # an error, already printed
        raise SystemExit(app.return_code)
