"""What a run that the laptop drives needs before it arms; and the time after which its overrides lapse."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import mock

import pytest
from fake_vehicle import FakeVehicle, wait_until
from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.errors import RoverSweepError
from rover_sweep.manoeuvre.sweep import Doublet
from rover_sweep.vehicle.events import Armed, Event
from rover_sweep.vehicle.link.inbox import LinkQuality
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.run.controls import RunSettings
from rover_sweep.vehicle.run.one_run import one_run

DRIVE = RunSettings(arm=True, throttle_us=1710, trigger="override", patience=20)


@pytest.fixture(autouse=True)
def short_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rover_sweep.vehicle.parameters._TIMEOUT", 0.2)


def run(link: Link, tmp_path: Path) -> Iterator[Event]:
    return one_run(link, Doublet(), "doublet", tmp_path / "doublet.tlog", DRIVE)


def parameter(name: str, value: float) -> Callable[[FakeVehicle], None]:
    return lambda vehicle: vehicle.parameters.update({name: value})


def dead_applet(vehicle: FakeVehicle) -> None:
    vehicle.drop = lambda message: message.get_type() == "NAMED_VALUE_FLOAT"


def in_a_run(vehicle: FakeVehicle) -> None:
    vehicle._applet = lambda: None  # type: ignore[method-assign]
    vehicle._state = 6


def without_speed(vehicle: FakeVehicle) -> None:
    vehicle.drop = lambda message: message.get_type() == "LOCAL_POSITION_NED"


def rolling(vehicle: FakeVehicle) -> None:
    def told() -> None:
        vehicle._send(m.MAVLink_local_position_ned_message(int(vehicle.now * 1000), 0, 0, 0, 0.8, 0, 0))

    without_speed(vehicle)
    send = vehicle.drop
    vehicle._applet = told  # type: ignore[method-assign]
    vehicle.drop = lambda message: send(message) and message.vx != pytest.approx(0.8)


def stick(number: int, us: int) -> Callable[[FakeVehicle], None]:
    return lambda vehicle: vehicle.sticks.update({number: us})


@pytest.mark.parametrize(
    ("happen", "said"),
    [
        (stick(3, 1000), r"the throttle stick \(RC3\) is at 1000 us, its neutral at 1500 us"),
        (stick(3, 1531), r"the throttle stick \(RC3\) is at 1531 us"),
        (stick(1, 1460), r"the steering stick \(RC1\) is at 1460 us"),
        (stick(3, 0), r"no throttle stick \(RC3 has no value\)"),
        (parameter("SWP_LAPSE", 1.0), "another ground station overrides this rover"),
        (parameter("FS_THR_ENABLE", 0.0), "would not detect the loss of the safety pilot's transmitter"),
        (parameter("RC_OVERRIDE_TIME", 0.0), "accepts no throttle or switch from a ground station"),
        (dead_applet, "does not report its state"),
        (in_a_run, "the applet is already in a run .*; throw its switch low"),
        (without_speed, "does not send its speed"),
        (rolling, "the rover moves at 0.8 m/s; it must be at rest"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_a_rover_that_is_not_ready_is_not_armed(link, vehicle, tmp_path, happen, said, monkeypatch):
    monkeypatch.setattr("rover_sweep.vehicle.run.takeover._CLEARS", 0.2)
    happen(vehicle)
    with pytest.raises(RoverSweepError, match=said):
        list(run(link, tmp_path))
    assert not vehicle.armed_ever and not vehicle.of_kind("RC_CHANNELS_OVERRIDE")


@pytest.mark.parametrize(
    ("quality", "said"),
    [
        (LinkQuality(seconds=10.0, frames=100, lost=0.4), "the link loses 40% of the frames"),
        (LinkQuality(seconds=10.0, frames=100, latency=1.5), "an answer takes 1.5 s"),
    ],
)
def test_a_poor_link_is_not_driven_over(link, vehicle, tmp_path, quality, said):
    with (
        mock.patch.object(Link, "quality", quality),
        pytest.raises(RoverSweepError, match=f"is not driven over this link: {said}"),
    ):
        list(run(link, tmp_path))
    assert not vehicle.armed_ever


def test_the_override_lapses_sooner_in_a_run_and_as_before_after_it(link, vehicle, tmp_path, monkeypatch):
    monkeypatch.setattr("rover_sweep.vehicle.run.takeover._HURRIED", float("inf"))  # its clock is a fast one
    while_armed = [
        vehicle.parameters["RC_OVERRIDE_TIME"] for e in run(link, tmp_path) if isinstance(e, Armed)
    ]
    assert while_armed == [1.75]
    assert wait_until(lambda: vehicle.parameters["RC_OVERRIDE_TIME"] == 3.0)


def test_sticks_within_their_dead_zone_are_neutral(link, vehicle, tmp_path):
    vehicle.sticks = {1: 1530, 3: 1470}
    assert any(isinstance(e, Armed) for e in run(link, tmp_path))


def test_each_override_of_a_driven_run_differs_from_the_last(link, vehicle, tmp_path):
    """By that the applet knows that they come from a program that lives."""
    list(run(link, tmp_path))
    sent = [message.chan1_raw for message in vehicle.of_kind("RC_CHANNELS_OVERRIDE")]
    assert len(sent) > 20 and sent[-1] == 0  # released
    assert all(a != b for a, b in zip(sent, sent[1:-4], strict=False))
    assert {us for us in sent if us} == {1499, 1500, 1501, 1502}
