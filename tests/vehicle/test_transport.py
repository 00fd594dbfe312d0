"""Bytes over UDP and a serial line; and who may know pymavlink."""

from __future__ import annotations

import os
import re
import socket
from pathlib import Path

import pytest
from greeted import heartbeat

import rover_sweep.vehicle
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.link.transport import open_transport, parse_url


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


def test_wrong_serial_devices(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="cannot open /dev/no_such_tty: .*plugged in"):
        open_transport("/dev/no_such_tty")
    with pytest.raises(LinkError, match=r"^/dev/null is not a serial port; give the vehicle's[^()]*$"):
        open_transport("/dev/null")
    with pytest.raises(UsageError, match="baud rate 12345"):
        open_transport("/dev/null,12345")


@pytest.mark.parametrize("url", ["COM3:57600", "COM3,57600", "com12", "/dev/ttyUSB0:57600"])
def test_another_programs_form_of_a_serial_port_is_answered_with_ours(url: str) -> None:
    with pytest.raises(UsageError, match=r"/dev/ttyUSB0,57600$") as refused:
        parse_url(url)
    assert ("udp:0.0.0.0:14550" in str(refused.value)) == url.upper().startswith("COM")


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


def test_udp_that_spoke_first_hears_nobody_else() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        station = open_transport(f"udpout:127.0.0.1:{vehicle.getsockname()[1]}")
        station.send(b"hello")
        where = vehicle.recvfrom(100)[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(heartbeat(1), where)
            assert station.receive(1.0) == b""
        vehicle.sendto(b"any bytes", where)
        assert station.receive(1.0) == b"any bytes"
        station.close()


def test_pymavlink_is_known_to_one_module() -> None:
    folder = Path(rover_sweep.vehicle.__file__ or "").parent
    importing = re.compile(r"^\s*(from|import) pymavlink", re.MULTILINE)
    assert [p.name for p in folder.rglob("*.py") if importing.search(p.read_text())] == ["mavlink.py"]


@pytest.mark.parametrize("url", ["udp:0.0.0.0:²", "tcp:127.0.0.1:٣", f"tcp:a:{'9' * 5000}", "/dev/ttyS0,²"])
def test_digits_of_other_scripts_and_long_numerals_are_no_port(url: str) -> None:
    with pytest.raises(UsageError, match="is not a port or baud rate"):
        parse_url(url)
