"""How a session ends before its plan does: Ctrl-C, a run that was stopped, a rover left armed."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from fake_vehicle import SWITCH, FakeVehicle, wait_until
from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.manoeuvre.sweep import Doublet
from rover_sweep.session import session
from rover_sweep.session.folder import Session
from rover_sweep.session.session import SessionPlan, SessionRun, drive
from rover_sweep.vehicle.events import (
    Interrupted,
    Notice,
    RunFinished,
    SessionFinished,
    StateChanged,
    SwitchWanted,
)
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.run.controls import RunSettings

DRIVE = RunSettings(arm=True, throttle_us=1710, trigger="override", patience=20)
TWO = (SessionRun("one", Doublet()), SessionRun("two", Doublet()))


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rover_sweep.vehicle.parameters._TIMEOUT", 0.2)
    monkeypatch.setattr(session, "await_estimator", lambda _: iter(()))


def interrupted_in_state_6(vehicle: FakeVehicle, events: Generator[Any, None, None]) -> list[Any]:
    """All events of a session that gets a Ctrl-C in its first wave; the pilot throws the switch if asked."""
    seen, thrown = [], False
    event = next(events)
    while True:
        seen.append(event)
        if isinstance(event, SwitchWanted):
            vehicle._rc[SWITCH] = (1900 if event.position == "high" else 1000, 1e9)
        try:
            if isinstance(event, StateChanged) and event.state == 6 and not thrown:
                thrown = True
                event = events.throw(KeyboardInterrupt())
            else:
                event = next(events)
        except StopIteration:
            return seen


def aux_low(vehicle: FakeVehicle) -> list[Any]:
    sent = [c for c in vehicle.of_kind("COMMAND_LONG") if c.command == m.MAV_CMD_DO_AUX_FUNCTION]
    return [c for c in sent if (c.param1, c.param2) == (300, 0)]


def test_ctrl_c_ends_the_runs_and_goes_on_to_the_end(vehicle: FakeVehicle, tmp_path: Path) -> None:
    events = interrupted_in_state_6(vehicle, drive(vehicle.url, tmp_path, SessionPlan(TWO, DRIVE)))
    (stopped,) = [e for e in events if isinstance(e, Interrupted)]
    assert (stopped.name, stopped.failures, stopped.armed) == ("one", (), False)
    assert not vehicle.armed and vehicle.rc(SWITCH) < 1200
    end = events[-1]
    assert isinstance(end, SessionFinished) and end.runs == ()
    assert vehicle.of_kind("LOG_REQUEST_LIST")  # it went on to the logs
    assert not (tmp_path / "two.tlog").exists()


def test_ctrl_c_stops_the_applet_where_the_switch_is_the_pilots(vehicle: FakeVehicle, tmp_path: Path) -> None:
    plan = SessionPlan(TWO[:1], RunSettings(patience=30), logs=False)
    events = drive(vehicle.url, tmp_path, plan)
    seen = []
    for event in events:  # the pilot arms once the session is ready for him
        seen.append(event)
        if isinstance(event, Notice) and "waiting for the pilot to arm" in event.text:
            vehicle.armed = True
            break
    seen += interrupted_in_state_6(vehicle, events)
    (stopped,) = [e for e in seen if isinstance(e, Interrupted)]
    assert (stopped.failures, stopped.armed) == ((), True)
    assert len(aux_low(vehicle)) == 1
    assert not vehicle.of_kind("RC_CHANNELS_OVERRIDE") and vehicle.armed  # who armed disarms


def test_what_could_not_be_let_go_is_told(vehicle, tmp_path, monkeypatch):
    command = vehicle._command

    def refusing(message: Any) -> int:
        aux = message.command == m.MAV_CMD_DO_AUX_FUNCTION
        return m.MAV_RESULT_DENIED if aux else command(message)

    monkeypatch.setattr(vehicle, "_command", refusing)
    with Link.open(vehicle.url, tmp_path / "a.tlog") as link:
        vehicle.armed = True
        assert wait_until(lambda: link.receive(0.1) is not None and link.armed)
        finished: list[RunFinished] = []
        folder = Session.open(tmp_path / "b")
        events = session._run(link, TWO[0], folder, RunSettings(patience=30), finished)
        seen = interrupted_in_state_6(vehicle, events)
    (stopped,) = [e for e in seen if isinstance(e, Interrupted)]
    assert (
        "refuses to stop the applet" in stopped.failures[0] and "throw the switch low" in stopped.failures[0]
    )
    assert finished == []


def test_a_run_that_was_stopped_is_not_followed_by_another_that_arms(vehicle, tmp_path):
    vehicle.stop_text = "roll 31.0 > 30 deg"
    events = list(drive(vehicle.url, tmp_path, SessionPlan(TWO, DRIVE, logs=False)))
    finished = [e for e in events if isinstance(e, RunFinished)]
    assert [(run.name, run.completed) for run in finished] == [("one", False)]
    assert isinstance(events[-1], SessionFinished)


def test_the_log_waits_until_the_pilot_has_disarmed(link: Link, vehicle: FakeVehicle) -> None:
    vehicle.armed = True
    assert wait_until(lambda: link.receive(0.1) is not None and link.armed)
    waiting = session._disarmed(link, 30.0)
    notice = next(waiting)
    assert isinstance(notice, Notice) and "disarm the rover" in notice.text
    vehicle.armed = False
    with pytest.raises(StopIteration) as done:
        next(waiting)
    assert done.value.value is True


def test_a_rover_left_armed_keeps_its_log(link: Link, vehicle: FakeVehicle) -> None:
    vehicle.armed = True
    assert wait_until(lambda: link.receive(0.1) is not None and link.armed)
    waiting = session._disarmed(link, 0.2)
    next(waiting)
    assert "stays on its card" in next(waiting).text  # type: ignore[union-attr]
    with pytest.raises(StopIteration) as done:
        next(waiting)
    assert done.value.value is False
