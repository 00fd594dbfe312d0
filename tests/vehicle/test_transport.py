"""Bytes over UDP and a serial line; and who may know pymavlink."""

from __future__ import annotations

import errno
import os
import re
import socket
import time
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar
from unittest import mock

import pytest
import serial
import serial.tools.list_ports
from greeted import heartbeat

import rover_sweep.vehicle
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.link.transport import open_transport, serial_ports


def test_a_serial_line_carries_every_byte_unchanged() -> None:
    vehicle, station = os.openpty()
    port = open_transport(f"{os.ttyname(station)},57600")
    everything = bytes(range(256))
    try:
        assert port.receive(0.01) == b""
        os.write(vehicle, everything)
        got = b""
        while len(got) < 256 and (data := port.receive(1.0)):
            got += data
        assert got == everything
        port.send(everything)
        assert os.read(vehicle, 512) == everything
    finally:
        port.close()
        os.close(station)
        os.close(vehicle)


class FakePort:
    """Looks like pyserial's Serial on a computer with one port, COM5, behind which a vehicle speaks at
    115200 baud."""

    opened: ClassVar[list[FakePort]] = []

    def __init__(self, port: str, baudrate: int, **settings: object) -> None:
        if port != "COM5":  # the text of pyserial on Windows
            raise serial.SerialException(f"could not open port {port!r}: FileNotFoundError(2, 'not found')")
        self.port, self.baudrate, self.settings = port, baudrate, settings
        self.written = b""
        FakePort.opened.append(self)

    @property
    def in_waiting(self) -> int:
        return 100

    def read(self, size: int) -> bytes:
        time.sleep(0.001)
        self.left = getattr(self, "left", b"") or (heartbeat(1) if self.baudrate == 115200 else b"\x80" * 50)
        data, self.left = self.left[:size], self.left[size:]
        return data

    def write(self, data: bytes) -> None:
        self.written += data

    def close(self) -> None:
        FakePort.opened.remove(self)


@pytest.fixture
def com5(monkeypatch: pytest.MonkeyPatch) -> type[FakePort]:
    """One port with something plugged in, as Windows names it."""
    info = SimpleNamespace(device="COM5", name="COM5", description="CubeOrange (COM5)", vid=0x2DAE)
    other = SimpleNamespace(device="COM3", name="COM3", description="n/a", vid=None)
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: [other, info])
    monkeypatch.setattr(serial, "Serial", FakePort)
    monkeypatch.setattr(FakePort, "opened", [])
    monkeypatch.setattr("rover_sweep.vehicle.link.transport._HEARD_AT", {})
    return FakePort


@pytest.mark.parametrize("url", ["COM5:57600", "com5,57600"])
def test_a_windows_name_and_its_speed_reach_pyserial(com5: type[FakePort], url: str) -> None:
    port = open_transport(url)
    (opened,) = com5.opened
    assert (opened.port, opened.baudrate, opened.settings["exclusive"]) == ("COM5", 57600, True)
    port.send(b"hello")
    assert opened.written == b"hello"
    assert port.receive(0.1)
    port.close()


def test_without_a_speed_the_usual_ones_are_tried(com5, monkeypatch):
    monkeypatch.setattr("rover_sweep.vehicle.link.transport._SPEED_TRIED", 0.05)
    port = open_transport("COM5")
    (opened,) = com5.opened
    tried = []
    until = time.monotonic() + 0.3
    while time.monotonic() < until:
        port.receive(0.01)
        tried.append(opened.baudrate)
    assert tried[0] == 57600 and set(tried) == {57600, 115200}
    assert tried == sorted(tried)  # once a frame was heard, the speed stays
    port.close()
    open_transport("COM5").close()
    again = open_transport("com5")
    assert com5.opened[0].baudrate == 115200  # at once
    again.close()


def test_a_missing_port_names_those_that_are_there(com5, monkeypatch):
    assert serial_ports() == {"COM5": "CubeOrange", "COM3": ""}
    with pytest.raises(LinkError, match="^there is no serial port COM7; plugged in: COM5: CubeOrange, COM3$"):
        open_transport("COM7:57600")
    monkeypatch.setattr("serial.tools.list_ports.comports", list)
    with pytest.raises(LinkError, match="COM7; no serial port is plugged in"):
        open_transport("COM7")


def test_wrong_serial_devices() -> None:
    with pytest.raises(LinkError, match="there is no serial port /dev/no_such_tty; .*plugged in"):
        open_transport("/dev/no_such_tty")
    with pytest.raises(LinkError, match=r"^/dev/null is not a serial port; [^()]*plugged in"):
        open_transport("/dev/null")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (serial.SerialException("could not open: PermissionError(13, 'Access')"), "another program uses"),
        (serial.SerialException(errno.EAGAIN, "Could not exclusively lock port"), "another program uses"),
        (serial.SerialException(errno.EACCES, "could not open port"), "join the group dialout"),
        (ValueError("Failed to set custom baud rate"), "does not support baud rate 7"),
    ],
)
def test_why_a_serial_port_does_not_open(error, words, monkeypatch):
    monkeypatch.setattr(serial, "Serial", mock.Mock(side_effect=error))
    with pytest.raises((LinkError, UsageError), match=words):
        open_transport("COM5:7")


def test_a_second_program_is_refused_and_a_pulled_cable_is_told() -> None:
    vehicle, station = os.openpty()
    port = open_transport(f"{os.ttyname(station)},57600")
    with pytest.raises(LinkError, match=f"another program uses {os.ttyname(station)}"):
        open_transport(os.ttyname(station))
    os.close(vehicle)
    for use in (lambda: port.receive(1.0), lambda: port.send(b"x")):
        with pytest.raises(ConnectionResetError, match="went away"):
            use()
    port.close()
    os.close(station)


def test_a_wait_is_as_long_as_asked() -> None:
    vehicle, station = os.openpty()
    port = open_transport(os.ttyname(station))
    for wait in (0.0, 0.003, 0.1):
        began = time.monotonic()
        assert port.receive(wait) == b""
        assert wait <= time.monotonic() - began < wait + 0.05
    port.close()
    os.close(station)
    os.close(vehicle)


def test_udp_answers_the_vehicle() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        number = free.getsockname()[1]
    station = open_transport(f"udp:127.0.0.1:{number}")
    vehicle = open_transport(f"udpout:127.0.0.1:{number}")
    station.send(b"to nobody")
    hello = heartbeat(1)
    vehicle.send(hello)
    assert station.receive(1.0) == hello
    station.settle(1)
    station.send(b"yes")
    assert vehicle.receive(1.0) == b"yes"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.1", 0))
        stranger.sendto(hello, ("127.0.0.1", number))
        assert station.receive(1.0) == b""
        assert f"127.0.0.1:{stranger.getsockname()[1]} are ignored" in station.remark()
        assert station.remark() == ""
        station.send(b"still you")
        assert vehicle.receive(1.0) == b"still you"
        stranger.setblocking(False)
        with pytest.raises(BlockingIOError):
            stranger.recv(100)
    with pytest.raises(LinkError, match="another ground station"):
        open_transport(f"udp:127.0.0.1:{number}")
    station.close()
    vehicle.close()


def test_pymavlink_is_known_to_one_module() -> None:
    folder = Path(rover_sweep.vehicle.__file__ or "").parent
    importing = re.compile(r"^\s*(from|import) pymavlink", re.MULTILINE)
    assert [p.name for p in folder.rglob("*.py") if importing.search(p.read_text())] == ["mavlink.py"]
