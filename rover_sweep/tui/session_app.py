"""The session behind the views: its one `State`, reduced from what the source tells, its plan, what is asked.

Nothing is asked of the source but in answer to a key (a connection that was made is looked at by itself,
which changes nothing); a run in which this program arms or throws the switch follows a question that one
deliberate key answers.
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

from rover_sweep.live.source import Connect, DriveRequest, Ended, Fix, Preflight, Request, Several, Source
from rover_sweep.session.session import SessionRun
from rover_sweep.tui.drawn import labels
from rover_sweep.tui.drawn.palette import DARK, LIGHT, Palette
from rover_sweep.tui.drawn.question import Question
from rover_sweep.tui.jobs.analysis import AnalysisJob
from rover_sweep.tui.jobs.desk import Desk, command_inputs
from rover_sweep.tui.model.connections import ConnectionChoice, places, with_systems
from rover_sweep.tui.model.feed import Feed
from rover_sweep.tui.model.plan_rows import FIRST, SPEED, Row, ground, with_names
from rover_sweep.tui.model.setup import Setup, recall, remember, serial_ports, with_url
from rover_sweep.tui.model.state import Asked, RunRecord, State, reduce
from rover_sweep.vehicle.events import RunFinished, RunStarted


class Arrived(Message):
    """The feed has something."""


class SessionApp(App[None]):
    """`source` does the work; `setup` is what the command line said."""

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
        self.desk = Desk(self.redraw, setup.folder)
        self.feed = Feed(lambda: self.post_message(Arrived()))
        self._speed, self._asked_at = math.nan, 0.0
        self.set_reactive(SessionApp.state, State(runs=setup.driven, logs=setup.logs))
        self.set_reactive(SessionApp.plan, setup.plan or FIRST)
        self.set_reactive(SessionApp.chosen, self._first_left())

    # ---- views, of whoever shows them ------------------------------------------------------------

    def redraw(self) -> None:
        """Shows the state as it is now."""
        raise NotImplementedError

    def turn_to(self, view: str, only_from: tuple[str, ...]) -> None:
        """Shows a view, in place of one of those that it follows."""
        raise NotImplementedError

    # ---- from the source -------------------------------------------------------------------------

    def on_arrived(self) -> None:
        """Everything that has come, drawn once."""
        for told in self.feed.take():
            before = self.state
            self.set_reactive(SessionApp.state, reduce(before, told))
            self._follow(told, before)
        self.redraw()

    def watch_state(self) -> None:
        self.redraw()

    def watch_plan(self) -> None:
        self.redraw()

    def watch_chosen(self) -> None:
        self.redraw()

    def _follow(self, told: object, before: State) -> None:
        """Turns to the view in which something has happened, where a person waits for it."""
        if isinstance(told, Ended) and isinstance(told.request, Connect) and not told.failure:
            self.memory = with_url(self.memory, told.request.url)
            remember(self.setup.memory, self.memory)
            self.ask(Preflight())
            self.turn_to("preflight", ("connect",))
        elif isinstance(told, Several):
            self.places = with_systems(self.places, told.url, told.heard)
        elif isinstance(told, RunStarted):
            self.turn_to("run", ("plan", "verdict"))
        elif isinstance(told, Ended) and isinstance(told.request, Fix) and not told.failure:
            self.ask(Preflight())
        elif isinstance(told, RunFinished):
            self.chosen = self._first_left()
        elif self.state.verdict is not before.verdict and self.state.verdict is not None:
            self.turn_to("verdict", ("run",))

    # ---- to the source ---------------------------------------------------------------------------

    def ask(self, request: Request) -> None:
        """Asks, and notes that it was asked."""
        self._asked_at = self._asked_at if self.state.busy else time.monotonic()
        self.state = reduce(self.state, Asked(request))
        self.source.ask(request)

    def connect(self, url: str, system: int | None = None) -> None:
        """Opens the link; what must be right is looked at then."""
        self.ask(Connect(url, system))

    def look_for_ports(self) -> None:
        """The connections that can be chosen now."""
        self.places = places(self.setup.url, self.memory.urls, serial_ports())

    @property
    def waited(self) -> float:
        """For how long the source has been at work on what was asked, s."""
        return time.monotonic() - self._asked_at if self.state.busy else 0.0

    @property
    def may_drive(self) -> bool:
        """Whether a run can be asked for."""
        state = self.state
        ready = state.vehicle is not None and not state.lost and state.played is None
        return ready and not state.busy and not state.under_way and self.next_row is not None

    @property
    def next_row(self) -> Row | None:
        """The row that is driven next."""
        return self.plan[self.chosen] if self.chosen < len(self.plan) else None

    @property
    def driving_speed(self) -> float:
        """At which the run under way is planned, m/s; NaN where it was not."""
        return self._speed if self.state.driving else math.nan

    def drive_next(self) -> None:
        """Drives the chosen row; asks first where this program arms or throws the switch."""
        row = self.next_row
        if row is None or not self.may_drive:
            return
        own = self.setup.own_part
        if not own:
            self._drive(row)
            return
        question = (
            f"{row.name}: {labels.manoeuvre(row.manoeuvre)} at {row.speed:g} m/s, "
            f"{labels.seconds(row.manoeuvre.duration)}{ground(row, self.setup.vehicle)}.\n\n"
            f"This program {', '.join(own)}.\n\nIs the ground free, and is everybody clear of it?"
        )
        self.push_screen(Question(question, "start the run"), partial(self._consented, row))

    def _consented(self, row: Row, yes: bool | None) -> None:
        if yes and self.may_drive:
            self._drive(row)

    def _drive(self, row: Row) -> None:
        self._speed = row.speed
        self.setup.keep_plan(self.plan)  # the usual one too, which nobody has changed
        self.ask(DriveRequest(SessionRun(row.name, row.manoeuvre, row.speed), self.setup.settings))
        self.turn_to("run", ("plan", "verdict"))

    def _first_left(self) -> int:
        """Index of the first row that was not driven to its end."""
        done = {(run.name, run.manoeuvre) for run in self.state.runs if run.outcome == "done"}
        left = (n for n, row in enumerate(self.plan) if (row.name, row.manoeuvre) not in done)
        return next(left, len(self.plan))

    # ---- the plan, and what is worked out beside the session ---------------------------------------

    def replan(self, plan: tuple[Row, ...], chosen: int) -> None:
        """Another plan, kept on disk; one of its rows is chosen."""
        self.plan = with_names(plan, (run.name for run in self.state.runs))
        self.setup.keep_plan(self.plan)
        self.chosen = max(0, min(chosen, len(plan) - 1))

    def choose(self, index: int) -> None:
        """The row that is driven next."""
        self.chosen = index % len(self.plan) if self.plan else 0

    def plan_repeat(self, run: RunRecord) -> None:
        """The run once more, with the amplitude that its verdict proposes, as the next."""
        proposed = round(run.verdict.amplitude) if run.verdict and run.verdict.amplitude else None
        manoeuvre = replace(run.manoeuvre, amplitude=float(proposed or run.manoeuvre.amplitude))
        row = Row(manoeuvre, self._speed if self._speed > 0 else SPEED)
        at = min(self.chosen, len(self.plan))
        self.replan((*self.plan[:at], row, *self.plan[at:]), at)
        self.turn_to("plan", ("verdict",))

    def propose(self) -> None:
        """What is worth driving beside the plan."""
        if self.setup.vehicle_path is not None:
            self.desk.propose(self.plan, self.setup.vehicle_path)
            self.redraw()

    def can_analyse(self, kind: str) -> bool:
        """Whether there is something to identify from."""
        folder = self.setup.folder
        ready = folder is not None and self.setup.vehicle_path is not None
        if kind == "gains":
            return ready and self.desk.report() is not None
        return ready and folder is not None and bool(command_inputs(self.state, folder))

    def analyse(self, kind: str, chosen: AnalysisJob | None = None) -> None:
        """Starts the command beside the session; gains out of the chosen report, where that is one."""
        setup = self.setup
        if setup.folder is not None and setup.vehicle_path is not None:
            self.desk.start(kind, self.state, setup.folder, setup.vehicle_path, self.desk.report(chosen))

    def open_page(self, page: Path) -> None:
        """In the browser."""
        self.run_worker(partial(webbrowser.open, page.resolve().as_uri()), thread=True, exit_on_error=False)
