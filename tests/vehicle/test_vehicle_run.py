"""A run: what it may move, and that everything is let go however it ends."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_vehicle import SWITCH, THROTTLE, FakeVehicle, wait_until
from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.manoeuvre.sweep import Doublet
from rover_sweep.vehicle.events import (
    Armed,
    Event,
    Notice,
    RunFinished,
    Said,
    Sample,
    StateChanged,
    SwitchWanted,
)
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.streams import stream_fault
from rover_sweep.vehicle.run import one_run as run_module
from rover_sweep.vehicle.run.controls import Controls, RunSettings
from rover_sweep.vehicle.run.one_run import one_run

DRIVE = RunSettings(arm=True, throttle_us=1710, trigger="override", patience=20)


@pytest.fixture(autouse=True)
def short_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rover_sweep.vehicle.parameters._TIMEOUT", 0.2)
    monkeypatch.setattr("rover_sweep.vehicle.run.controls.INSISTS", 2.0)


def _run(link: Link, tmp_path: Path, settings: RunSettings = DRIVE) -> Iterator[Event]:
    return one_run(link, Doublet(), "doublet", tmp_path / "doublet.tlog", settings)


def _until_state(events: Iterator[Event], state: int) -> None:
    for event in events:
        if isinstance(event, StateChanged) and event.state == state:
            return
    pytest.fail(f"state {state} never came")


def _is_let_go(vehicle: FakeVehicle) -> bool:
    return not vehicle.armed and vehicle.rc(SWITCH) < 1200 and vehicle.rc(THROTTLE) == 1500


def test_a_whole_run(link: Link, vehicle: FakeVehicle, tmp_path: Path) -> None:
    events = list(_run(link, tmp_path))
    states = [event.state for event in events if isinstance(event, StateChanged)]
    assert states == [1, 2, 3, 4, 5, 6, 7, 8, 9, 0]
    finished = events[-1]
    assert isinstance(finished, RunFinished)
    assert (finished.completed, finished.number) == (True, 1)
    assert finished.reason == "the manoeuvre ran to its end"
    assert finished.span[1] - finished.span[0] == pytest.approx(9, abs=2)
    assert all(not stream_fault(quality, 50) for quality in finished.quality)
    assert any(isinstance(event, Armed) for event in events)
    sample = [event for event in events if isinstance(event, Sample)][-1]
    assert sample.r == pytest.approx(-0.25)  # ISO: FRD's right turn is negative
    assert finished.tlog.stat().st_size > 10_000
    assert _is_let_go(vehicle)
    assert wait_until(lambda: vehicle.of_kind("RC_CHANNELS_OVERRIDE")[-1].chan6_raw == 0)
    last = vehicle.of_kind("RC_CHANNELS_OVERRIDE")[-1]
    assert (last.chan1_raw, last.chan3_raw, last.chan6_raw) == (0, 0, 0)
    assert last.chan2_raw == 0xFFFF  # a channel that is not ours is never touched


def test_without_consent_nothing_is_armed_or_moved(link: Link, vehicle: FakeVehicle, tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="not armed within 3 s"):
        list(_run(link, tmp_path, RunSettings(patience=3)))
    assert not vehicle.armed_ever
    assert not vehicle.of_kind("RC_CHANNELS_OVERRIDE")
    with pytest.raises(UsageError, match="allow arming too"):
        RunSettings(throttle_us=1700)
    with pytest.raises(UsageError, match="out of range"):
        RunSettings(arm=True, throttle_us=2500)


def test_the_pilot_arms_and_throws_the_switch(link: Link, vehicle: FakeVehicle, tmp_path: Path) -> None:
    vehicle.armed = True
    wanted = []
    for event in _run(link, tmp_path, RunSettings(patience=30)):
        if isinstance(event, SwitchWanted):
            wanted.append(event.position)
            vehicle._rc[SWITCH] = (1900 if event.position == "high" else 1000, 1e9)
    assert wanted == ["high", "low"]
    assert isinstance(event, RunFinished)
    assert event.completed
    assert vehicle.armed  # who armed disarms
    assert not vehicle.of_kind("RC_CHANNELS_OVERRIDE")


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_an_exception_lets_go(link, vehicle, tmp_path, error):
    events = _run(link, tmp_path)
    _until_state(events, 6)
    assert vehicle.rc(THROTTLE) == 1710
    with pytest.raises(error):
        events.throw(error())  # type: ignore[attr-defined]
    assert wait_until(lambda: _is_let_go(vehicle), 2)


def test_closing_the_generator_lets_go(link: Link, vehicle: FakeVehicle, tmp_path: Path) -> None:
    events = _run(link, tmp_path)
    _until_state(events, 2)
    events.close()  # type: ignore[attr-defined]
    assert wait_until(lambda: _is_let_go(vehicle), 2)


def test_a_second_interrupt_still_lets_go(link, vehicle, tmp_path, monkeypatch):
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    events = _run(link, tmp_path)
    _until_state(events, 6)
    monkeypatch.setattr("rover_sweep.vehicle.run.controls.pump", interrupted)
    with pytest.raises(KeyboardInterrupt):
        events.throw(KeyboardInterrupt())  # type: ignore[attr-defined]
    assert wait_until(lambda: _is_let_go(vehicle), 2)


@pytest.mark.parametrize("step", ["_stop_now", "_settle", "_disarm", "_release"])
def test_a_disk_that_fills_while_letting_go_stops_nothing(link, vehicle, tmp_path, monkeypatch, step):
    fails, whole = [UsageError("the disk is full")], getattr(Controls, step)

    def once(controls: Controls) -> None:
        if fails:
            raise fails.pop()
        whole(controls)

    monkeypatch.setattr(Controls, step, once)
    events = list(_run(link, tmp_path))
    assert any(isinstance(e, Notice) and "the disk is full" in e.text for e in events)
    assert wait_until(lambda: _is_let_go(vehicle), 5)


def test_the_applet_stops(link: Link, vehicle: FakeVehicle, tmp_path: Path) -> None:
    vehicle.stop_text = "roll 31.0 > 30 deg and this text is long enough for a second chunk"
    events = list(_run(link, tmp_path))
    finished = events[-1]
    assert isinstance(finished, RunFinished)
    assert (finished.completed, finished.reason) == (False, vehicle.stop_text)
    assert any(isinstance(event, Said) and vehicle.stop_text in event.text for event in events)
    assert _is_let_go(vehicle)


def test_refused_arming_names_the_vehicles_reason(link: Link, vehicle: FakeVehicle, tmp_path: Path) -> None:
    vehicle.refuse_arming = "PreArm: GPS 1: Bad fix"
    with pytest.raises(LinkError, match="not armed within 5 s.*PreArm: GPS 1: Bad fix"):
        list(_run(link, tmp_path, RunSettings(arm=True, trigger="override", patience=5)))


def test_an_applet_that_does_not_start(link, vehicle, tmp_path, monkeypatch):
    monkeypatch.setattr(run_module, "_START_LIMIT", 2.0)
    vehicle._applet = lambda: None  # type: ignore[method-assign]
    with pytest.raises(LinkError, match="did not start within 2 s of switch 6 and sent no message"):
        list(_run(link, tmp_path))
    assert wait_until(lambda: _is_let_go(vehicle), 2)


def test_a_switch_that_the_radio_holds_up_is_named(link, vehicle, tmp_path, monkeypatch):
    """The applet begins with a switch that it has seen low (4.6.3: RC_CHANNELS shows the radio's)."""
    monkeypatch.setattr(run_module, "_START_LIMIT", 2.0)

    def radio() -> None:
        pwm = [1500] * 18
        vehicle._send(m.MAVLink_rc_channels_message(int(vehicle.now * 1000), 8, *pwm, 255))

    vehicle._applet = radio  # type: ignore[method-assign]
    settings = RunSettings(arm=True, throttle_us=1710, trigger="aux", patience=20)
    with pytest.raises(LinkError, match="radio holds that channel at 1500 us.*throw switch 6 low"):
        list(_run(link, tmp_path, settings))
