"""The link to a vehicle: finding it, losing it, its clock, what we send by that clock."""

from __future__ import annotations

from pathlib import Path

import pytest
from fake_vehicle import FakeVehicle, wait_until
from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.identity import check_applet, identify_vehicle
from rover_sweep.vehicle.link.connection import Periodic
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.transport import Address, parse_url
from rover_sweep.vehicle.setup import reboot


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("tcp:127.0.0.1:5760", Address("tcp", "127.0.0.1", 5760)),
        ("udp:0.0.0.0:14550", Address("udpin", "0.0.0.0", 14550)),
        ("udpout:10.0.0.2:14550", Address("udpout", "10.0.0.2", 14550)),
        ("/dev/ttyACM0,921600", Address("serial", "/dev/ttyACM0", 921600)),
        ("/dev/ttyUSB0", Address("serial", "/dev/ttyUSB0", 0)),
        ("/dev/ttyUSB0:57600", Address("serial", "/dev/ttyUSB0", 57600)),
        ("com12", Address("serial", "COM12", 0)),
        ("COM5:57600", Address("serial", "COM5", 57600)),
        ("COM5,57600", Address("serial", "COM5", 57600)),
        ("/dev/serial/by-path/usb-0:1:1.0", Address("serial", "/dev/serial/by-path/usb-0:1:1.0", 0)),
        ("/dev/serial/by-path/usb-0:1,9600", Address("serial", "/dev/serial/by-path/usb-0:1", 9600)),
    ],
)
def test_urls(url: str, address: Address) -> None:
    assert parse_url(url) == address


@pytest.mark.parametrize(
    "url", ["rover", "tcp:host", "/dev/ttyACM0,fast", "udp:0.0.0.0:²", f"tcp:a:{'9' * 5000}"]
)
def test_a_wrong_url_is_a_usage_error(url: str) -> None:
    with pytest.raises(UsageError, match="connection|is not a port or baud rate"):
        parse_url(url)


def test_nobody_there(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="cannot open tcp:127.0.0.1:1: .*is the vehicle running"):
        Link.open("tcp:127.0.0.1:1", tmp_path / "a.tlog")
    with pytest.raises(LinkError, match="no heartbeat .* within 0 s"):
        Link.open("udp:127.0.0.1:0", tmp_path / "b.tlog", timeout=0.2)


def test_we_are_the_ground_station_that_overrides_are_taken_from(link: Link, vehicle: FakeVehicle) -> None:
    assert wait_until(lambda: link.receive(0.1) is not None and bool(vehicle.of_kind("HEARTBEAT")))
    heartbeat = vehicle.of_kind("HEARTBEAT")[0]
    assert heartbeat.get_srcSystem() == 255
    assert heartbeat.type == m.MAV_TYPE_GCS


def test_our_heartbeat_keeps_the_pace_of_a_fast_vehicle(link: Link, vehicle: FakeVehicle) -> None:
    start, before = link.clock.now, len(vehicle.of_kind("HEARTBEAT"))
    while link.clock.now < start + 20:
        link.receive(0.5)
    assert wait_until(lambda: len(vehicle.of_kind("HEARTBEAT")) - before >= 18)


def test_periodic_runs_by_the_faster_clock_and_after_a_reboot() -> None:
    times: list[float] = []
    periodic = Periodic(1.0, lambda: times.append(0))
    for vehicle, wall in [(0, 0), (0.5, 0.1), (1.1, 0.2), (1.2, 0.9), (1.3, 1.3), (0.0, 1.4)]:
        periodic.run_if_due(vehicle, wall)
    assert len(times) == 4


def test_messages_without_heartbeat_are_told(tmp_path: Path) -> None:
    with FakeVehicle() as vehicle, Link.open(vehicle.url, tmp_path / "a.tlog") as link:
        vehicle.drop = lambda message: message.get_type() == "HEARTBEAT"
        with pytest.raises(LinkError, match="no heartbeat for 10 s"):
            while link.clock.now < 60:
                link.receive(0.1)


def test_a_closed_connection_is_told(link: Link, vehicle: FakeVehicle) -> None:
    vehicle.hang_up()
    with pytest.raises(LinkError, match="ended .*is the vehicle still running"):
        while True:
            link.receive(0.1)


@pytest.mark.parametrize("closes", [True, False])
def test_reboot_and_reconnect(link: Link, vehicle: FakeVehicle, closes: bool) -> None:
    if closes:
        vehicle.drop = lambda message: (
            message.get_type() == "COMMAND_ACK"
            and message.command == m.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
            and vehicle.hang_up() is not None
        )
    before = link.clock.now
    reboot(link)
    assert len([c for c in vehicle.of_kind("COMMAND_LONG") if c.command == 246]) == 1
    assert link.heartbeat is not None
    assert link.clock.now < before + 3600
    assert link.receive(1.0) is not None


@pytest.mark.parametrize(
    ("fake", "words"),
    [
        (FakeVehicle(vehicle_type=m.MAV_TYPE_QUADROTOR), "is a quadrotor, not a ground rover"),
        (FakeVehicle(vehicle_type=m.MAV_TYPE_SURFACE_BOAT), "is a surface boat, not a ground rover"),
        (FakeVehicle(autopilot=m.MAV_AUTOPILOT_PX4), "is not ArduPilot"),
        (FakeVehicle(version=(4, 2, 0)), "4.2.0 is too old"),
    ],
)
def test_others_are_refused(fake: FakeVehicle, words: str, tmp_path: Path) -> None:
    with fake, Link.open(fake.url, tmp_path / "a.tlog") as link, pytest.raises(LinkError, match=words):
        identify_vehicle(link)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"SWP_ENABLE": None, "SCR_ENABLE": 0.0}, "SCR_ENABLE is 0"),
        ({"SWP_ENABLE": None}, "rover-sweep firmware install"),
        ({"SWP_ENABLE": None, "SCR_ENABLE": None}, "no Lua scripting"),
        ({"SWP_ENABLE": 0.0}, "switched off"),
        ({"SWP_GCS": None}, "another version \\(no SWP_GCS\\)"),
    ],
)
def test_applet_check(change, words, tmp_path, monkeypatch):
    monkeypatch.setattr("rover_sweep.vehicle.parameters._TIMEOUT", 0.1)
    fake = FakeVehicle()
    for name, value in change.items():
        if value is None:
            del fake.parameters[name]
        else:
            fake.parameters[name] = value
    with fake, Link.open(fake.url, tmp_path / "a.tlog") as link, pytest.raises(LinkError, match=words):
        check_applet(link)
