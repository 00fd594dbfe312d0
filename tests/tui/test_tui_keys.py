"""Keys: nothing is asked without one, abort works from everywhere, what arms is asked about first."""

from __future__ import annotations

import asyncio
import signal
from dataclasses import replace
from unittest import mock

import pytest
from scenes import OWN, SETUP, Step, after, played
from scripted_source import (
    CHECKS,
    SWEEP,
    TLOG,
    URL,
    ScriptedSource,
    connected,
    drive,
    finished,
    snapshot,
    under_way,
)
from seen import text_of
from textual.pilot import Pilot

from rover_sweep.live.source import (
    Checked,
    Connect,
    DriveRequest,
    Ended,
    FetchLogs,
    Fix,
    Lost,
    Play,
    Played,
    Preflight,
    Several,
)
from rover_sweep.manoeuvre.sweep import ThrottleSweep
from rover_sweep.session.session import SessionRun
from rover_sweep.system import STOP_SIGNALS
from rover_sweep.tui.app import SweepApp, show
from rover_sweep.tui.drawn import Question
from rover_sweep.tui.model.plan_rows import Row
from rover_sweep.tui.screens.frame import VIEWS
from rover_sweep.tui.screens.plan import PlanScreen
from rover_sweep.tui.screens.run import RunScreen
from rover_sweep.vehicle import events as e
from rover_sweep.vehicle.link.connection import Heard, SeveralVehicles

READY: tuple[Step, ...] = ("enter", connected(), [Ended(Preflight())])
DRIVEN: tuple[Step, ...] = (*READY, "3", "g", under_way())
OWN_SETUP = replace(SETUP, settings=OWN)


async def press(pilot: Pilot[None], *keys: str) -> None:
    for key in keys:
        await pilot.press(key)
    await pilot.pause()


def drives(source: ScriptedSource) -> list[DriveRequest]:
    return [request for request in source.asked if isinstance(request, DriveRequest)]


@played(())
async def test_nothing_is_asked_without_a_key(app, source, pilot) -> None:
    for told in (*connected()[:1], snapshot(1.0), Checked(CHECKS), *under_way(), *finished()[:3]):
        source.tell(told)
        await pilot.pause(0)
    assert source.asked == [] and source.aborted == 0


@played(("enter", connected()))
async def test_enter_connects_and_looks(app, source, pilot) -> None:
    assert source.asked == [Connect(URL), Preflight()]
    assert "[2 PREFLIGHT]" in text_of(app)


def test_of_several_rovers_one_is_chosen_in_the_list() -> None:
    both = Several(URL, (Heard(1, "ground rover"), Heard(7, "ground rover")))
    refused = Ended(Connect(URL), str(SeveralVehicles(URL, both.heard)))

    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        assert "system 1 (ground rover)" in text_of(app) and "system 7 (ground rover)" in text_of(app)
        await press(pilot, "down", "enter")
        assert source.asked == [Connect(URL), Connect(URL, 7)]

    after(("enter", [both, refused]), then)


@played(READY, OWN_SETUP)
async def test_a_throttle_sweep_is_planned_by_a_key_and_confirmed_as_any_run(app, source, pilot) -> None:
    await press(pilot, "3", "h")
    row = app.plan[app.chosen]
    assert (row.name, row.manoeuvre) == ("throttle1", ThrottleSweep(amplitude=30))
    assert drives(source) == []
    await press(pilot, "g")
    assert isinstance(app.screen, Question) and "throttle1" in text_of(app) and drives(source) == []
    await press(pilot, "n", "g", "y")
    (asked,) = drives(source)
    assert asked.planned == SessionRun("throttle1", ThrottleSweep(amplitude=30), 2.0)


def test_in_a_throttle_sweep_the_pilot_steers() -> None:
    sweep = ThrottleSweep(amplitude=30)
    begin = [e.RunStarted("throttle1", sweep, TLOG), e.Armed(3.0)]

    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        for state, words in ((2, "hold the throttle stick still"), (6, "only steer"), (9, "let it roll out")):
            source.tell(snapshot(10.0 + state, state=state))
            await pilot.pause()
            assert words in " ".join(text_of(app).split()), state
            assert "release the stick" not in text_of(app)

    after((*READY, "3", "h", "g", begin), then)


@pytest.mark.parametrize("key", ["f", "F"])
@played(READY)
async def test_a_remedy_takes_one_key_and_is_looked_at_again(app, source, pilot, key: str) -> None:
    await press(pilot, key)  # the applet, the first that is bad
    assert source.asked[-1] == Fix("applet")
    source.tell(Ended(Fix("applet")))
    await pilot.pause()
    assert source.asked[-1] == Preflight()


@played(READY)
async def test_only_y_reboots(app, source, pilot) -> None:
    await press(pilot, *["down"] * 7, "f")
    assert "BY HAND: throw switch 6 low" in text_of(app)
    assert source.asked[-1] == Preflight(), "what only a person can do is no key"
    await press(pilot, *["up"] * 6)
    for no in ("space", "enter", "escape", "n"):
        await press(pilot, "f", no)
        assert not any(isinstance(request, Fix) for request in source.asked), no
    await press(pilot, "f", "y")
    assert source.asked[-1] == Fix("parameters", reboot=True)


@played((*READY, "3"), OWN_SETUP)
async def test_a_run_that_arms_asks_once_per_run_and_only_y_says_yes(app, source, pilot) -> None:
    for no in ("space", "enter", "escape", "g", "n"):
        await press(pilot, "g", no)
        assert not drives(source), no
    await press(pilot, "g", "y")
    (asked,) = drives(source)
    assert asked.settings == OWN and asked.planned.name == "sweep1"
    for told in (*under_way(), *finished()[:3], Ended(asked)):
        source.tell(told)
        await pilot.pause(0)
    await pilot.pause()
    await press(pilot, "3", "g")
    assert len(drives(source)) == 1, "the next run asks again"
    await press(pilot, "y")
    assert [run.planned.name for run in drives(source)] == ["sweep1", "sweep2"]


@played((*READY, "3", "g"))
async def test_settings_are_those_of_the_command_line(app, source, pilot) -> None:
    (asked,) = drives(source)
    settings = asked.settings
    assert not settings.arm and settings.throttle_us is None and settings.trigger == "pilot"


@played(DRIVEN)
async def test_abort_from_every_view(app, source, pilot) -> None:
    for number, view in enumerate(VIEWS, 1):
        await press(pilot, str(number))
        shown = text_of(app)
        assert f"{view.upper()}]" in shown and "SPACE or ESC" in shown
    for number, view in enumerate(VIEWS, 1):
        await press(pilot, str(number))
        for key in ("space", "escape"):  # each is answered at once, and works again
            before = source.aborted
            await press(pilot, key)
            assert source.aborted == before + 1 and "ABORTING" in text_of(app), (view, key)


@played((*READY, "3", "g"))
async def test_abort_before_the_source_has_begun_and_while_a_row_is_edited(app, source, pilot) -> None:
    await press(pilot, "space")
    assert source.aborted == 1
    await press(pilot, "3", "e", "escape")
    assert source.aborted == 2


@played((*READY, [snapshot(3.0, state=6)]))
async def test_abort_of_a_run_that_nobody_here_asked_for(app, source, pilot) -> None:
    await press(pilot, "space")
    assert source.aborted == 1


@played(READY)
async def test_without_a_run_abort_is_no_key(app, source, pilot) -> None:
    await press(pilot, "space", "escape")
    assert source.aborted == 0 and "ABORT" not in text_of(app)


@pytest.mark.parametrize("key", ["q", "ctrl+c", "ctrl+q"])
@played(DRIVEN)
async def test_leaving_during_a_run_ends_that_first(app, source, pilot, key: str) -> None:
    await press(pilot, key)
    assert source.aborted == 1 and app.is_running
    for told in (e.Interrupted("sweep1", TLOG, (), False, True), snapshot(20.0, state=0), Ended(drive())):
        source.tell(told)
    await pilot.pause()
    await press(pilot, key)
    assert not app.is_running


@played(DRIVEN)
async def test_a_second_run_cannot_be_asked_for_during_one(app, source, pilot) -> None:
    await press(pilot, "3", "g", "4", "g", "5", "g")
    assert len(drives(source)) == 1


@played(DRIVEN)
async def test_a_view_that_was_left_goes_on_when_it_is_shown_again(app, source, pilot) -> None:
    await press(pilot, "6", "4")
    source.tell(snapshot(40.0, speed=3.21))
    await pilot.pause()
    assert "3.21 m/s" in text_of(app) and app.screen.is_running


@played((*DRIVEN, finished()))
async def test_the_amplitude_proposed_becomes_the_next_run(app, source, pilot) -> None:
    await press(pilot, "w")
    assert "[3 PLAN]" in text_of(app)
    await press(pilot, "g")
    again = drives(source)[-1].planned
    assert again.name == "sweep3" and again.manoeuvre == replace(SWEEP, amplitude=220.0)


@played((*DRIVEN, finished()))
async def test_logs_are_fetched_only_from_a_rover_that_is_disarmed(app, source, pilot) -> None:
    await press(pilot, "6", "l")
    assert FetchLogs() not in source.asked  # armed
    source.tell(snapshot(80.0, armed=False, state=0))
    await pilot.pause()
    await press(pilot, "l")
    assert source.asked[-1] == FetchLogs()


@played(([Played(34.0, 120.0, 2.0), snapshot(34.0)], "4"))
async def test_a_recording_is_paused_sought_and_paced(app, source, pilot) -> None:
    await press(pilot, "space", ".", ",", "+", "-")
    burst = [Play(0.0), Play(at=44.0), Play(at=34.0), Play(4.0), Play(2.0)]
    assert source.asked == burst, "each goes on from the one before, which is not done yet"
    for told in (*map(Ended, burst), Played(34.0, 120.0, 0.0)):
        source.tell(told)
    await pilot.pause()
    await press(pilot, "space")
    assert source.asked[-1] == Play(2.0), "it goes on at the pace it had"
    assert source.aborted == 0


@pytest.mark.parametrize("size", [(20, 4), (40, 10)])
@played(DRIVEN)
async def test_any_size_is_survived(app, source, pilot, size: tuple[int, int]) -> None:
    for view in range(1, 8):
        await press(pilot, str(view))
        await pilot.resize_terminal(*size)
        await pilot.pause()
        shown = text_of(app)
        assert "cannot be drawn" not in shown
        if size == (40, 10):
            assert "SPACE or ESC ABORTS" in shown and "The window is 40x10" in shown
        await pilot.resize_terminal(80, 24)
    await press(pilot, "space")
    assert source.aborted == 1


@played((*READY, "3"), OWN_SETUP)
async def test_a_key_does_nothing_where_the_window_cannot_show_what(app, source, pilot) -> None:
    await pilot.resize_terminal(40, 10)
    await press(pilot, "g", "y", "4", "G", "y")
    assert not drives(source)
    await pilot.resize_terminal(80, 24)
    await press(pilot, "g")
    await pilot.resize_terminal(30, 6)  # the question does not fit
    await press(pilot, "y")
    assert not drives(source)
    await pilot.resize_terminal(80, 24)
    await press(pilot, "g", "y")
    assert len(drives(source)) == 1


@played((*DRIVEN, finished()), replace(SETUP, vehicle_path=None, vehicle=None))
async def test_without_a_vehicle_file_nothing_is_identified_and_it_says_why(app, source, pilot) -> None:
    await press(pilot, "7", "i", "d", "s")
    assert "start again with --vehicle rover.toml" in text_of(app)
    assert app.analyses.jobs == ()


@played(DRIVEN)
async def test_errors_of_the_source_are_sentences(app, source, pilot) -> None:
    source.tell(Lost("nothing was heard of the rover for 3 s"))
    source.tell(Ended(source.asked[-1], "the link was lost while the run was driven"))
    await pilot.pause()
    shown = text_of(app)
    assert "LINK LOST" in shown and "NO LINK" in shown
    await press(pilot, "6")
    shown = text_of(app)
    assert "ERROR: link lost: nothing was heard of the rover for 3 s" in shown
    assert "ERROR: the link was lost while the run was driven" in shown


def test_a_view_that_cannot_be_drawn_and_a_key_that_goes_wrong_leave_abort(monkeypatch):
    monkeypatch.setattr(RunScreen, "picture", mock.Mock(side_effect=ZeroDivisionError("speed")))
    monkeypatch.setattr(PlanScreen, "action_add", lambda screen, kind: ()[0])

    async def then(app: SweepApp, source: ScriptedSource, pilot: Pilot[None]) -> None:
        await press(pilot, "3", "a", "6")
        assert "WARNING: internal error on this key: IndexError" in text_of(app)
        await press(pilot, "space", "4")
        assert source.aborted == 1
        assert "This view cannot be drawn (ZeroDivisionError('speed'))" in text_of(app)
        await press(pilot, "space")
        assert source.aborted == 2

    after(DRIVEN, then)


ONE_ROW = (Row(SWEEP, 2.0, "sweep1"),)


@played((*READY, "3", "g", under_way(), finished(), "3"), replace(SETUP, plan=ONE_ROW))
async def test_every_key_of_a_plan_that_is_driven(app, source, pilot) -> None:
    for key in ("a", "d", "m", "b", "e", "x", "up", "down", "g"):
        app.plan, app.chosen = ONE_ROW, 1
        assert app.next_row is None
        await press(pilot, key)
        assert "internal error" not in text_of(app) and len(drives(source)) == 1, key
        await press(pilot, "escape", "x", "x", "x")
        assert not any("internal error" in line.text for line in app.state.messages), key


class ReleasedLate(ScriptedSource):
    """Signals come while it is closed."""

    def close(self) -> str:
        for number in STOP_SIGNALS * 3:
            signal.raise_signal(number)
        super().close()
        return "The rover may still be armed"


def test_signals_in_a_row_do_not_end_the_release(monkeypatch, capsys):
    """Neither while the views close nor afterwards, when asyncio has none of its handlers any more."""
    source, before = ReleasedLate(), {number: signal.getsignal(number) for number in STOP_SIGNALS}

    async def closing(app: SweepApp) -> None:
        app.source.start(app.feed.put)
        for number in STOP_SIGNALS:
            signal.raise_signal(number)

    monkeypatch.setattr(SweepApp, "run", lambda app, **_: asyncio.run(closing(app)))
    monkeypatch.setattr("rover_sweep.tui.app.end_with_parent", lambda end: None)
    show(source, SETUP, in_browser=True)
    assert source.closed and source.aborted == 4 * len(STOP_SIGNALS)
    assert capsys.readouterr().err == "rover-sweep: The rover may still be armed\n"
    assert {number: signal.getsignal(number) for number in STOP_SIGNALS} == before
