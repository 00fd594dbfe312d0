"""The session behind the views: its `State`, reduced from the source's messages, its plan and its requests.

Every request to the source follows a key; only the checks after connecting start automatically, and they
change nothing. Before a run in which this program arms or throws the switch, the user must confirm with a
separate key.
"""

from __future__ import annotations

import math
import time
import webbrowser
from dataclasses import replace
from functools import partial
from pathlib import Path

from textual.app import App
from textual.message import Message
from textual.reactive import reactive

from rover_sweep.live.source import (
    Checked,
    Connect,
    DriveRequest,
    Ended,
    Fix,
    Preflight,
    Request,
    Several,
    Source,
)
from rover_sweep.session.content import SessionRun
from rover_sweep.tui.drawn import DARK, LIGHT, Palette, Question, ago, moved, switch_label
from rover_sweep.tui.jobs import Analyses, AnalysisJob, command_inputs
from rover_sweep.tui.model.plan_rows import FIRST, SPEED, Row, with_names
from rover_sweep.tui.model.setup import (
    ConnectionChoice,
    Feed,
    Setup,
    places,
    question_before,
    recall,
    remember,
    with_systems,
    with_url,
)
from rover_sweep.tui.model.state import Asked, RunRecord, State, reduce
from rover_sweep.vehicle import events as e
from rover_sweep.vehicle.link.transport import serial_ports


class Arrived(Message):
    """Messages are waiting in the feed."""


_OLD = 60.0  # s


def _outside(state: State) -> tuple[object, ...]:
    """Values in the status row that the checks judge: mode, arming, switch, fix, EKF."""
    now = state.snapshot
    return () if now is None else (now.mode, now.armed, switch_label(now.switch), now.fix, now.ekf)


class SessionApp(App[None]):
    """State and requests of a session; `source` does the work, `setup` has the command line's settings."""

    state: reactive[State] = reactive(State(), init=False)
    plan: reactive[tuple[Row, ...]] = reactive((), init=False)
    chosen: reactive[int] = reactive(0, init=False)

    def __init__(self, source: Source, setup: Setup) -> None:
        super().__init__()
        self.source, self.setup = source, setup
        self.memory = recall(setup.memory)
        self.palette: Palette = DARK if self.memory.dark else LIGHT
        self.places: tuple[ConnectionChoice, ...] = ()
        self.look_for_ports()
        self.analyses = Analyses(self.redraw, setup.folder)
        self.feed = Feed(lambda: self.post_message(Arrived()))
        self._speed, self._asked_at, self._checked_at = math.nan, 0.0, 0.0
        self._checked_on: tuple[object, ...] = ()
        self.set_reactive(SessionApp.state, State(runs=setup.driven, logs=setup.logs))
        self.set_reactive(SessionApp.plan, setup.plan or FIRST)
        self.set_reactive(SessionApp.chosen, self._first_left())

    # ---- views, implemented by the application ------------------------------------------------------------

    def redraw(self) -> None:
        """Draw the current state."""
        raise NotImplementedError

    def turn_to(self, view: str, only_from: tuple[str, ...]) -> None:
        """Show a view, if the current one is in `only_from`."""
        raise NotImplementedError

    # ---- from the source -------------------------------------------------------------------------

    def on_arrived(self) -> None:
        """Process all waiting messages, then draw once."""
        for message in self.feed.take():
            before = self.state
            self.set_reactive(SessionApp.state, reduce(before, message))
            self._follow(message, before)
        self.redraw()

    def watch_state(self) -> None:
        self.redraw()

    def watch_plan(self) -> None:
        self.redraw()

    def watch_chosen(self) -> None:
        self.redraw()

    def _follow(self, message: object, before: State) -> None:
        """Start the checks after connecting or a fix, and show the view that the user is waiting for."""
        if isinstance(message, Ended) and isinstance(message.request, Connect) and not message.failure:
            self.memory = with_url(self.memory, message.request.url)
            remember(self.setup.memory, self.memory)
            self.ask(Preflight())
            self.turn_to("preflight", ("connect",))
        elif isinstance(message, Checked):
            self._checked_at, self._checked_on = time.monotonic(), _outside(self.state)
        elif isinstance(message, Several):
            self.places = with_systems(self.places, message.url, message.heard)
        elif isinstance(message, e.RunStarted):
            self.turn_to("run", ("plan", "verdict"))
        elif isinstance(message, Ended) and isinstance(message.request, Fix) and not message.failure:
            self.ask(Preflight())
        elif isinstance(message, e.RunFinished):
            self.chosen = self._first_left()
        elif self.state.verdict is not before.verdict and self.state.verdict is not None:
            self.turn_to("verdict", ("run",))

    # ---- to the source ---------------------------------------------------------------------------

    def ask(self, request: Request) -> None:
        """Record the request in the state, then send it to the source."""
        self._asked_at = self._asked_at if self.state.busy else time.monotonic()
        self.state = reduce(self.state, Asked(request))
        self.source.ask(request)

    def connect(self, url: str, system: int | None = None) -> None:
        """Open the link; the preflight checks follow."""
        self.ask(Connect(url, system))

    def look_for_ports(self) -> None:
        """Update the list of connections."""
        self.places = places(self.setup.url, self.memory.urls, serial_ports())

    @property
    def waited(self) -> float:
        """Time since the oldest pending request, s."""
        return time.monotonic() - self._asked_at if self.state.busy else 0.0

    @property
    def checks_old(self) -> bool:
        """True if the rover changed since the shown checks, or they are older than a minute."""
        return self.checks_age > _OLD or _outside(self.state) != self._checked_on

    @property
    def checks_age(self) -> float:
        """Time since the shown checks, s."""
        return time.monotonic() - self._checked_at if self.state.checks else 0.0

    @property
    def may_drive(self) -> bool:
        """True if a run can be started now."""
        state = self.state
        ready = state.vehicle is not None and not state.lost and state.played is None
        return ready and not state.busy and not state.under_way and self.next_row is not None

    @property
    def next_row(self) -> Row | None:
        """The row to drive next, None if all are driven."""
        return self.plan[self.chosen] if self.chosen < len(self.plan) else None

    @property
    def driving_speed(self) -> float:
        """Planned speed of the current run, m/s; NaN if unknown."""
        return self._speed if self.state.driving else math.nan

    def drive_next(self) -> None:
        """Drive the chosen row; asks first if this program arms or throws the switch, or if it is kept."""
        row = self.next_row
        if row is None or not self.may_drive:
            return
        question = question_before(row, self.setup, self.state, ago(self.checks_age))
        if not question:
            self._drive(row)
            return
        self.push_screen(Question(question, "start the run"), partial(self._consented, row, self.setup))

    def _consented(self, row: Row, asked: Setup, yes: bool | None) -> None:
        if yes and self.may_drive and self.setup is asked:  # a yes is to what the question named
            self._drive(row)

    def can_lower_throttle(self, run: RunRecord | None) -> bool:
        """True if the run was too fast with the throttle that is still set."""
        step = run.verdict.throttle if run and run.verdict else None
        return step is not None and step[0] == self.setup.settings.throttle_us and not self.state.under_way

    def lower_throttle(self, run: RunRecord) -> None:
        """Set the throttle of the next runs to the value that the run's verdict proposes; drives nothing."""
        if self.can_lower_throttle(run) and run.verdict and run.verdict.throttle:
            driven, lower = run.verdict.throttle
            settings = replace(self.setup.settings, throttle_us=lower)
            self.setup = replace(self.setup, settings=settings)
            words = f"throttle lowered from {driven} to {lower} us for the next runs; G asks before each"
            self.state = reduce(self.state, e.Notice("info", words))

    def _drive(self, row: Row) -> None:
        self._speed = row.speed
        self.setup.keep_plan(self.plan)  # the default plan too
        self.ask(DriveRequest(SessionRun(row.name, row.manoeuvre, row.speed), self.setup.settings))
        self.turn_to("run", ("plan", "verdict"))

    def _first_left(self) -> int:
        """Index of the first row without a complete run."""
        done = {(run.name, run.manoeuvre) for run in self.state.runs if run.outcome == "done"}
        left = (n for n, row in enumerate(self.plan) if (row.name, row.manoeuvre) not in done)
        return next(left, len(self.plan))

    # ---- the plan, and analysis jobs ---------------------------------------

    def replan(self, plan: tuple[Row, ...], chosen: int) -> None:
        """Replace the plan, save it, and choose one of its rows."""
        self.plan = with_names(plan, (run.name for run in self.state.runs))
        self.setup.keep_plan(self.plan)
        self.chosen = max(0, min(chosen, len(plan) - 1))

    def choose(self, index: int) -> None:
        """Choose the row to drive next."""
        self.chosen = moved(index, 0, len(self.plan))

    def plan_repeat(self, run: RunRecord) -> None:
        """Plan the run again as the next one, with the amplitude that its verdict proposes."""
        proposed = round(run.verdict.amplitude) if run.verdict and run.verdict.amplitude else None
        manoeuvre = replace(run.manoeuvre, amplitude=float(proposed or run.manoeuvre.amplitude))
        row = Row(manoeuvre, self._speed if self._speed > 0 else SPEED)
        at = min(self.chosen, len(self.plan))
        self.replan((*self.plan[:at], row, *self.plan[at:]), at)
        self.turn_to("plan", ("verdict",))

    def propose(self) -> None:
        """Start the computation of further runs to drive."""
        if self.setup.vehicle_path is not None:
            self.analyses.propose(self.plan, self.setup.vehicle_path)
            self.redraw()

    def choose_next(self) -> None:
        """Start the choice of the next run from the complete runs; it is added to the plan, not driven."""
        folder, vehicle = self.setup.folder, self.setup.vehicle_path
        if folder is not None and vehicle is not None:
            fastest = max((row.speed for row in self.plan), default=SPEED)
            self.analyses.choose_next(command_inputs(self.state, folder), vehicle, fastest, self._add_next)
            self.redraw()

    def _add_next(self, rows: tuple[Row, ...]) -> None:
        self.replan((*self.plan, *rows), self.chosen)  # a row that waits to be driven stays the next one

    def can_analyse(self, kind: str) -> bool:
        """True if the session has the recordings or the report that the command needs."""
        folder = self.setup.folder
        ready = folder is not None and self.setup.vehicle_path is not None
        if kind == "gains":  # from the rover's present parameters, which its log has
            return ready and bool(self.state.logs) and self.analyses.report() is not None
        whole = any(run.outcome == "done" for run in self.state.runs)
        return ready and whole and folder is not None and bool(command_inputs(self.state, folder))

    def analyse(self, kind: str, chosen: AnalysisJob | None = None) -> None:
        """Start the command in the background; gains use the chosen report, if it is one."""
        setup = self.setup
        if setup.folder is not None and setup.vehicle_path is not None:
            self.analyses.start(
                kind, self.state, setup.folder, setup.vehicle_path, self.analyses.report(chosen)
            )

    def open_page(self, page: Path) -> None:
        """Open a report in the browser."""
        self.run_worker(partial(webbrowser.open, page.resolve().as_uri()), thread=True, exit_on_error=False)
