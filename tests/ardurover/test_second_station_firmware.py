"""A second ground station on another serial port of the official firmware, with this program's system id."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil

from firmware_params.applet_parameters import applet_path
from firmware_params.param_files import shipped
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.session import await_estimator, start_streams
from rover_sweep.vehicle.events import Event, Notice, RunFinished, Sample, StateChanged
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.run.controls import RunSettings, pump
from rover_sweep.vehicle.run.one_run import one_run
from sitl.launcher import start_ardurover

pytestmark = pytest.mark.ardurover

SWEEP = Sweep(amplitude=100, w_min=3, w_max=20, t_rec=8, fade=0.5, dwell=0.5, straight=1)
SETTINGS = RunSettings(True, 1710, "override", {"gcs": 1.0, "v_min": 1.0, "v_max": 5.0, "still": 1.0})
INTO = 2.0  # s of the sweep


@pytest.fixture(scope="module")
def rover(ardurover: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Link, Any]]:
    """(this program's link, the other station's connection)"""
    home = tmp_path_factory.mktemp("rover")
    with (
        start_ardurover(
            ardurover, home, defaults=[shipped("identification")], scripts=[applet_path()]
        ) as running,
        Link.open(running.connection, home / "connect.tlog", timeout=60.0) as link,
    ):
        host, _, port = running.connection.rpartition(":")
        other = mavutil.mavlink_connection(f"{host}:{int(port) + 2}", source_system=255)
        list(start_streams(link))
        list(await_estimator(link))
        yield link, other
        other.close()


def driven(rover: tuple[Link, Any], tlog: Path, act: Callable[[Any], None]) -> list[Event]:
    """The events of a run; from INTO the sweep on the other station acts at each sample."""
    link, other = rover
    events, since = list[Event](), float("inf")
    for event in one_run(link, SWEEP, "sweep1", tlog, SETTINGS):
        events.append(event)
        if isinstance(event, StateChanged) and event.state == 6:
            since = event.t
        if isinstance(event, Sample) and event.t > since + INTO:
            other.mav.heartbeat_send(6, 8, 0, 0, 0)
            act(other)
        while other.recv_msg() is not None:
            pass
    pump(link, 1.0)
    return events


def finished(events: list[Event]) -> RunFinished:
    (end,) = (event for event in events if isinstance(event, RunFinished))
    return end


def reads_and_asks_for_streams(other: Any) -> None:
    other.mav.param_request_read_send(1, 1, b"INS_GYRO_FILTER", -1)
    other.mav.request_data_stream_send(1, 1, 0, 2, 1)


def throttle(other: Any) -> None:
    ignored = [0xFFFF] * 5
    other.mav.rc_channels_override_send(1, 1, 0xFFFF, 0xFFFF, 1800, *ignored)


def hold(other: Any) -> None:
    other.mav.command_long_send(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0)


def test_it_may_read_and_ask_for_streams_on_its_own_port(rover: tuple[Link, Any], tmp_path: Path) -> None:
    events = driven(rover, tmp_path / "a.tlog", reads_and_asks_for_streams)
    assert finished(events).completed
    rates = {quality.message: quality.mean_hz for quality in finished(events).quality}
    assert rates["ATTITUDE"] > 40.0


def test_a_parameter_that_it_sets_is_told(rover: tuple[Link, Any], tmp_path: Path) -> None:
    values = iter([10.0])

    def sets(other: Any) -> None:
        for value in values:  # once
            other.mav.param_set_send(1, 1, b"INS_ACCEL_FILTER", value, 9)

    events = driven(rover, tmp_path / "b.tlog", sets)
    assert finished(events).completed
    assert any("changed INS_ACCEL_FILTER" in e.text for e in events if isinstance(e, Notice))


@pytest.mark.parametrize(
    ("act", "words"),
    [(throttle, "at 1800 us, which this program did not send"), (hold, "mode 4, not MANUAL")],
)
def test_what_it_does_ends_the_run(
    rover: tuple[Link, Any], tmp_path: Path, act: Callable[[Any], None], words: str
) -> None:
    link, _ = rover
    end = finished(driven(rover, tmp_path / "c.tlog", act))
    assert not end.completed and words in end.reason and not link.armed
    link.command("MAV_CMD_DO_SET_MODE", 1.0, 0.0)
    time.sleep(4.0)  # its overrides lapse
    pump(link, 1.0)
