"""Ctrl-C, signals and errors of the display, in any number: the rover is let go, and only what it confirmed
is said to be released. A run that came to its end stays a complete run.
"""

from __future__ import annotations

import errno
import json
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from virtual_faults import hammered, hole
from virtual_line import VirtualLine
from virtual_record import Record
from virtual_run import SETTINGS, SWEEP, Happening
from virtual_world import At, Fault, World

from rover_sweep.cli.driving.session_display import show_session
from rover_sweep.cli.views.display import PlainDisplay
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.session import folder as session_folder
from rover_sweep.session.content import DrivenRun, SessionRun
from rover_sweep.session.folder import read_folder
from rover_sweep.session.session import SessionPlan, drive
from rover_sweep.system import STOP_SIGNALS
from rover_sweep.vehicle.events import Event, Interrupted, Notice, RunFinished, RunStarted, StateChanged
from rover_sweep.vehicle.run.controls import MAY_BE_ARMED

Shown = Callable[[Event, World], None]
_STEERS = 6  # SWP_ST
RELEASED = "sweep1 interrupted: the rover was released"


@dataclass(frozen=True)
class Result:
    """What came of a session on the terminal. error: what it raised; said: on stderr and in its notes."""

    world: World
    error: BaseException | None
    said: str
    run: DrivenRun

    @property
    def record(self) -> Record:
        return self.world.record

    @property
    def armed(self) -> bool:
        """Whether the rover was armed when the session had ended."""
        return self.record.rows[-1].armed


@pytest.fixture
def play(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Plays a session of `runs` through the display, which calls `shown` with each event first."""
    before = {number: signal.getsignal(number) for number in STOP_SIGNALS}

    def played(*happenings: Happening, shown: Shown = lambda event, world: None, runs: int = 1) -> Result:
        world = World(tmp_path / "vehicle", limit=200.0)
        for at, fault in happenings:
            world.happen(at, fault)
        show = PlainDisplay.show

        def showing(self: PlainDisplay, event: Event) -> None:
            if isinstance(event, RunStarted):
                world.enter("arming")
            shown(event, world)
            show(self, event)

        monkeypatch.setattr(PlainDisplay, "show", showing)
        folder, error = tmp_path / "session", None
        planned = tuple(SessionRun(f"sweep{n}", SWEEP) for n in range(1, runs + 1))
        plan = SessionPlan(planned, SETTINGS, logs=False)
        try:
            show_session(drive("virtual:", folder, plan, VirtualLine(world)), folder)
        except BaseException as raised:
            error = raised
        assert {number: signal.getsignal(number) for number in STOP_SIGNALS} == before
        said = " ".join((capsys.readouterr().err, *getattr(error, "__notes__", ())))
        (run, *_) = read_folder(folder).runs
        return Result(world, error, said, run)

    return played


def state_on_disk(world: World) -> str:
    """Of the only run, in session.json."""
    content = json.loads((world.folder.parent / "session" / "session.json").read_text(encoding="utf-8"))
    return str(content["runs"][0]["state"])


# ---- Interrupts in a row.


def gone() -> Fault:
    """The connection is closed, and never opened again."""

    def refuse() -> None:
        raise LinkError("no such port")

    def begin(world: World) -> None:
        world.cut()
        world.connect = refuse  # type: ignore[method-assign]

    return Fault("gone", begin)


@pytest.mark.parametrize("number", [0, signal.SIGTERM, signal.SIGQUIT], ids=str)
@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_over_a_good_link_it_is_let_go(play, count: int, number: int) -> None:
    done = play((At("sweep", 1.0), hammered(count, number=number)))
    assert isinstance(done.error, KeyboardInterrupt) and not done.armed
    assert done.said.count("sweep1 interrupted") == 1 and MAY_BE_ARMED not in done.said
    if count < 3:  # the third one ends the wait for a parameter, which is said
        assert f"{RELEASED}, the pilot has steering and throttle; it is disarmed" in done.said
    assert done.run.state == "stopped"
    assert not done.run.left_armed or (number, count) == (0, 8)  # they end the wait for the next heartbeat
    assert done.record.seconds(since=done.world.entered["sweep"] * 1e-6) < 1.0 + 0.8


@pytest.mark.parametrize("number", [0, signal.SIGTERM], ids=str)
@pytest.mark.parametrize("count", [1, 2, 3, 8, 40])
@pytest.mark.parametrize("dead", [hole, gone], ids=["hole", "gone"])
def test_over_a_dead_link_nothing_is_said_to_be_released(play, dead, count: int, number: int) -> None:
    """The interrupts begin in the same step as the silence."""
    done = play((At("sweep", 1.0), dead()), (At("sweep", 1.0), hammered(count, number=number)))
    assert RELEASED not in done.said and "it is disarmed" not in done.said
    assert MAY_BE_ARMED in done.said, done.said
    assert (done.run.state, done.run.left_armed) == ("stopped", True)
    assert "nothing moves" not in done.said


def test_without_the_words_the_warning_is_missing(play, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rover_sweep.vehicle.run.controls.MAY_BE_ARMED", "")
    done = play((At("sweep", 1.0), hole()), (At("sweep", 1.0), hammered(3)))
    assert "still be armed" not in done.said


def test_what_the_applet_does_not_confirm_is_no_release(play) -> None:
    """The pilot's part of a link: the order to disarm comes through, the applet's report does not."""

    def lost(event: Event, world: World) -> None:
        if isinstance(event, StateChanged) and event.state == _STEERS:
            read = world.take
            world.take = lambda: read().replace(b"SWP_ST", b"SWP_XX")  # type: ignore[method-assign]

    done = play((At("sweep", 0.5), hammered(1)), shown=lost)
    assert RELEASED not in done.said and "did not confirm that it was released" in done.said


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=str)
def test_one_after_the_manoeuvre_starts_no_other_run(play, number: int) -> None:
    done = play((At("letting go"), hammered(1, number=number)), runs=2)
    assert isinstance(done.error, KeyboardInterrupt) and not done.armed
    assert done.run.state == "done" and len(done.record.begun) == 1
    assert "no run was in progress: this program moves nothing" in done.said


def test_one_while_a_warning_is_shown_does_not_hide_it(play) -> None:
    pressed = []

    def again(event: Event, world: World) -> None:
        if isinstance(event, Interrupted) and not pressed:
            pressed.append(event)
            signal.raise_signal(signal.SIGTERM)

    done = play((At("sweep", 1.0), hole()), (At("sweep", 1.0), hammered(2)), shown=again)
    assert pressed and MAY_BE_ARMED in done.said


# ---- A display that fails.

FAILURES = (RuntimeError("a mistake"), OSError(errno.EMFILE, "Too many open files"), MemoryError())


def failing(kind: type[Event], error: BaseException, state: int | None = None) -> Shown:  # type: ignore[valid-type]
    def shown(event: Event, world: World) -> None:
        if isinstance(event, kind) and (state is None or getattr(event, "state", None) == state):
            raise error

    return shown


@pytest.mark.parametrize("error", [*FAILURES, KeyboardInterrupt()], ids=repr)
@pytest.mark.parametrize("when", ["finished", "last state", "notice"])
def test_a_complete_run_stays_complete_whatever_its_display_does(play, when: str, error) -> None:
    seen: list[str] = []
    fails = {
        "finished": failing(RunFinished, error),
        "last state": failing(StateChanged, error, 0),
        "notice": failing(Notice, error),
    }[when]

    def shown(event: Event, world: World) -> None:
        if when == "finished" and isinstance(event, RunFinished):
            seen.append(state_on_disk(world))
        if world.record.completed:
            fails(event, world)

    # A notice after the run: the rover did not confirm the order to disarm.
    happenings = [(At("letting go", 0.2), hole(40.0, "up"))] if when == "notice" else []
    done = play(*happenings, shown=shown)
    assert type(done.error) is type(error)
    assert (done.run.state, done.run.reason) == ("done", "the manoeuvre ran to its end")
    assert done.run.span is not None and done.run.number == 1
    assert when != "finished" or seen == ["done"]


@pytest.mark.parametrize("error", FAILURES, ids=repr)
def test_a_display_that_fails_in_the_run_lets_go_at_once(play, error: BaseException) -> None:
    """And not when Python comes to it: the error goes up to the user with its traceback."""
    done = play(shown=failing(StateChanged, error, _STEERS))
    assert done.error is error and not done.armed
    assert (done.run.state, done.run.left_armed) == ("cut", False)


def test_what_is_not_released_after_a_failure_is_in_its_notes(play) -> None:
    def shown(event: Event, world: World) -> None:
        if isinstance(event, StateChanged) and event.state == _STEERS:
            gone().begin(world)
            raise RuntimeError("a mistake")

    done = play(shown=shown)
    assert isinstance(done.error, RuntimeError) and MAY_BE_ARMED in done.said


# ---- A disk that takes nothing at the moment at which a run ends.


@pytest.mark.parametrize("count", [0, 1], ids=["done", "interrupted"])
def test_a_disk_that_is_full_at_the_end_hides_nothing(play, count: int, monkeypatch) -> None:
    writes = session_folder._replace

    def full(path: Path, data: bytes) -> None:
        if b'"begun"' not in data and b'"state"' in data:
            raise UsageError(f"{path} cannot be written (Read-only file system)")
        writes(path, data)

    monkeypatch.setattr(session_folder, "_replace", full)
    done = play(*([(At("sweep", 1.0), hammered(count))] if count else []))
    assert not done.armed
    assert ("the rover was released" in done.said) == bool(count)
    assert isinstance(done.error, KeyboardInterrupt if count else UsageError)
    assert done.run.state == ("stopped" if count else "done")  # from its .tlog
