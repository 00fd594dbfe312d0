"""MAVLink signing: the key's file, a vehicle that wants it, and a key that is not its own."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import pytest
from fake_vehicle import FakeVehicle
from greeted import heartbeat
from pymavlink.dialects.v20 import ardupilotmega as m
from signing_vehicle import KEY, OTHER, SigningLine

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle.identity import identify_vehicle
from rover_sweep.vehicle.link.connection import Access
from rover_sweep.vehicle.link.greeting import Greeting
from rover_sweep.vehicle.link.inbox import RefusedHeartbeats
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import Codec, SigningKey, make, read_key, signs, timestamp
from rover_sweep.vehicle.parameters import read_parameter, write_parameter

RIGHT, WRONG = Access(key=SigningKey(KEY)), Access(key=SigningKey(OTHER))
NOW = 1.7e9  # s of UTC


@pytest.mark.parametrize(
    ("content", "secret"),
    [
        (KEY, KEY),
        (KEY.hex().encode(), KEY),
        (KEY.hex().upper().encode() + b"\r\n", KEY),
        (b"correct horse", hashlib.sha256(b"correct horse").digest()),
        (b"correct horse\n", hashlib.sha256(b"correct horse").digest()),
        (b"a passphrase of 31 characters..\n", hashlib.sha256(b"a passphrase of 31 characters..").digest()),
        ("schlüssel".encode(), hashlib.sha256("schlüssel".encode()).digest()),
    ],
    ids=["bytes", "hex", "HEX and line break", "passphrase", "and line break", "32 bytes of text", "UTF-8"],
)
def test_the_key_of_a_file(tmp_path: Path, content: bytes, secret: bytes) -> None:
    path = tmp_path / "key"
    path.write_bytes(content)
    assert read_key(path).secret == secret
    assert secret.hex() not in repr(read_key(path)) and repr(secret) not in repr(read_key(path))


@pytest.mark.parametrize("content", [b"", b"\n", b"\xff" * 31, b"two\nlines", b"x" * 5000])
def test_no_key_is_a_sentence_that_quotes_nothing(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "key"
    path.write_bytes(content)
    with pytest.raises(UsageError, match=r"\(\d+ bytes\) holds no signing key; give 32 bytes") as raised:
        read_key(path)
    assert "two" not in str(raised.value) and "xx" not in str(raised.value)
    with pytest.raises(UsageError, match="cannot be read: No such file"):
        read_key(tmp_path / "nothing")


def test_frames_are_signed_as_pymavlink_checks_them() -> None:
    frame = Codec(key=SigningKey(KEY), wall=NOW).pack(make("SYSTEM_TIME", time_unix_usec=1, time_boot_ms=2))
    assert signs(frame) and SigningKey(KEY).signed(frame) and not SigningKey(OTHER).signed(frame)
    vehicle = m.MAVLink(None, 1, 1)
    vehicle.signing.secret_key, vehicle.signing.timestamp = KEY, timestamp(NOW)
    assert vehicle.decode(bytearray(frame)).time_boot_ms == 2
    with pytest.raises(m.MAVError):
        vehicle.decode(bytearray(frame))  # a replay


def test_a_forged_frame_does_not_shut_the_vehicle_out() -> None:
    def told(key: bytes, wall: float) -> bytes:
        return Codec(1, 1, SigningKey(key), wall).pack(make("SYSTEM_TIME", time_unix_usec=1, time_boot_ms=2))

    station = Codec(key=SigningKey(KEY), wall=NOW)
    assert station.decode(told(OTHER, NOW + 1e6)) is None
    assert station.decode(told(KEY, NOW)) is not None
    assert station.decode(told(KEY, NOW)) is None  # the same again


@pytest.mark.parametrize("late", [0.0, 86_400.0])  # it takes the time from us
def test_with_its_key_a_vehicle_that_signs_is_as_any_other(tmp_path: Path, late: float) -> None:
    line = SigningLine(late=late)
    with (
        FakeVehicle() as vehicle,
        Link.open(vehicle.url, tmp_path / "a.tlog", line=line, access=RIGHT) as link,
    ):
        assert identify_vehicle(link).firmware == "ArduRover 4.6.3"
        write_parameter(link, "SWP_AMP", 77.0)
        assert read_parameter(link, "SWP_AMP") == 77.0
    assert {"HEARTBEAT", "COMMAND_LONG", "PARAM_SET"} <= set(line.heard)


def test_without_a_key_it_is_said_that_the_vehicle_signs(tmp_path: Path) -> None:
    words = r"signs its messages and answers no unsigned ones; give the key .* with --signing-key FILE"
    with FakeVehicle() as vehicle, pytest.raises(LinkError, match=words):
        Link.open(vehicle.url, tmp_path / "a.tlog", line=SigningLine())
    assert vehicle.of_kind("COMMAND_LONG") == []


def test_on_a_port_that_takes_unsigned_messages_no_key_is_wanted(tmp_path: Path) -> None:
    line = SigningLine(open_port=True)
    with FakeVehicle() as vehicle, Link.open(vehicle.url, tmp_path / "a.tlog", line=line) as link:
        assert identify_vehicle(link).firmware == "ArduRover 4.6.3"


def test_another_key_is_said(tmp_path: Path) -> None:
    words = "signs with another key than that of --signing-key; give the key that was set up on it"
    with FakeVehicle() as vehicle, pytest.raises(LinkError, match=words):
        Link.open(vehicle.url, tmp_path / "a.tlog", line=SigningLine(), access=WRONG)


def test_a_key_for_a_vehicle_that_does_not_sign_is_said(tmp_path: Path) -> None:
    with FakeVehicle() as vehicle, pytest.raises(LinkError, match="does not sign its messages"):
        Link.open(vehicle.url, tmp_path / "a.tlog", access=RIGHT)


def test_the_key_is_in_no_file_and_no_error(tmp_path: Path) -> None:
    with FakeVehicle() as vehicle:
        with Link.open(vehicle.url, tmp_path / "a.tlog", line=SigningLine(), access=RIGHT) as link:
            identify_vehicle(link)
        with pytest.raises(LinkError) as raised:
            Link.open(vehicle.url, tmp_path / "b.tlog", line=SigningLine(OTHER), access=RIGHT)
    for form in (KEY, KEY.hex().encode(), repr(KEY).encode()):
        assert not any(re.search(re.escape(form), path.read_bytes()) for path in tmp_path.iterdir())
        assert form not in (str(raised.value) + repr(RIGHT)).encode()


def test_why_a_heartbeat_is_refused() -> None:
    def why(frame: bytes) -> tuple[str, bool]:
        refusals = RefusedHeartbeats(SigningKey(KEY))
        refusals.look(frame, 10.0)
        assert (refusals.words("tcp:x") == "") == (refusals.why == "")
        return refusals.why, refusals.final(20.0)

    def beat(key: bytes) -> bytes:
        mav = m.MAVLink(None, srcSystem=1, srcComponent=1)
        mav.signing.secret_key, mav.signing.sign_outgoing = key, True
        return bytes(m.MAVLink_heartbeat_message(10, 3, 0, 0, 4, 3).pack(mav))

    assert why(beat(KEY)) == ("old", False)  # what we send puts its time right
    assert why(beat(OTHER)) == ("other key", True)
    assert why(heartbeat(1)) == ("unsigned", True)
    assert why(heartbeat(1, component=100)) == ("", False)


def test_on_udp_only_a_heartbeat_with_the_key_greets() -> None:
    rover, forger = ("10.0.0.2", 14550), ("10.0.0.9", 5555)
    signed = Codec(1, 1, SigningKey(KEY), NOW).pack(
        make(
            "HEARTBEAT", type=10, autopilot=3, base_mode=0, custom_mode=0, system_status=4, mavlink_version=3
        )
    )
    greeting = Greeting()
    greeting.believe(SigningKey(KEY).signed)
    assert greeting.takes(heartbeat(1), forger, 0.0)  # heard, so that it can be told what is wrong
    assert greeting.peer is None
    assert greeting.takes(signed, rover, 0.1) and greeting.peer == rover
    greeting.settle(1)
    assert greeting.peer == rover
    assert not greeting.takes(heartbeat(1), forger, 10.0)
    assert greeting.takes(signed, forger, 10.1) and greeting.peer == forger
