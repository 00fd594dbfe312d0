"""Whose datagrams count on a UDP port."""

from __future__ import annotations

import pytest
from greeted import heartbeat
from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.vehicle.link.greeting import SILENT, Greeting, why_overrides_ignored

ROVER, BRIDGE, STRANGER = ("10.0.0.2", 14550), ("10.0.0.2", 14999), ("10.0.0.9", 5555)


def greeted() -> Greeting:
    """A vehicle of id 1 at ROVER is spoken with; it was heard last at 10 s."""
    greeting = Greeting()
    assert greeting.takes(heartbeat(1), ROVER, 10.0)
    greeting.settle(1)
    assert greeting.peer == ROVER
    return greeting


@pytest.mark.parametrize(
    "datagram",
    [
        b"GET / HTTP/1.0\r\n",
        heartbeat(255, m.MAV_AUTOPILOT_INVALID, 190),
        heartbeat(1, component=100),
        heartbeat(1)[:-1] + b"\0",
    ],
    ids=["no mavlink", "ground station", "camera", "wrong checksum"],
)
def test_only_an_autopilots_heartbeat_opens_the_door(datagram: bytes) -> None:
    greeting = Greeting()
    assert not greeting.takes(datagram, STRANGER, 0.0)
    greeting.settle(1)
    assert not greeting.takes(datagram, STRANGER, 1.0)
    assert (greeting.peer, greeting.ignored) == (None, 2)


def test_nobody_is_answered_before_it_is_settled_who_is_meant() -> None:
    greeting = Greeting()
    assert greeting.takes(heartbeat(7), STRANGER, 0.0) and greeting.takes(heartbeat(1), ROVER, 0.1)
    assert greeting.peer is None
    greeting.settle(1)
    assert greeting.peer == ROVER
    assert not greeting.takes(heartbeat(7), STRANGER, 0.2)


def test_what_came_from_the_vehicle_before_its_heartbeat_is_no_stranger() -> None:
    greeting = Greeting()
    assert not greeting.takes(b"a router in the middle of a message", ROVER, 0.0)
    assert greeting.takes(heartbeat(1), ROVER, 0.1)
    greeting.settle(1)
    assert greeting.peer == ROVER and greeting.remark() == ""


def test_settled_first_another_vehicle_is_not_heard() -> None:
    greeting = Greeting()
    greeting.settle(1)
    assert not greeting.takes(heartbeat(7), STRANGER, 0.0)
    assert greeting.peer is None
    assert greeting.takes(heartbeat(1), ROVER, 0.1)
    assert greeting.peer == ROVER
    assert greeting.takes(b"any of its bytes", ROVER, 0.2)


def test_strangers_are_counted_and_told_once() -> None:
    greeting = greeted()
    for n in range(50):
        assert not greeting.takes(heartbeat(1), STRANGER, 10.0 + n * 0.01)
    assert (greeting.peer, greeting.ignored) == (ROVER, 50)
    words = greeting.remark()
    assert words.startswith(
        "datagrams from 10.0.0.9:5555 are ignored, because the vehicle is at 10.0.0.2:14550"
    )
    assert greeting.remark() == ""


def test_a_bridge_that_restarted_is_accepted_after_silence_by_its_vehicle() -> None:
    greeting = greeted()
    assert not greeting.takes(heartbeat(1), BRIDGE, 10.0 + SILENT)
    assert not greeting.takes(heartbeat(7), BRIDGE, 10.1 + SILENT)
    assert not greeting.takes(b"noise", BRIDGE, 10.2 + SILENT)
    assert greeting.takes(heartbeat(1), BRIDGE, 10.3 + SILENT)
    assert greeting.peer == BRIDGE
    assert not greeting.takes(heartbeat(1), ROVER, 10.4 + SILENT)


def test_a_heartbeat_cut_over_two_datagrams_is_heard() -> None:
    greeting, frame = Greeting(), heartbeat(1)
    assert not greeting.takes(frame[:7], ROVER, 0.0)
    assert greeting.takes(frame[7:], ROVER, 0.1)


def test_a_flood_of_addresses_fills_no_memory() -> None:
    greeting = Greeting()
    for n in range(1000):
        greeting.takes(b"\xfd", (f"10.1.{n // 250}.{n % 250}", 1), 0.0)
    assert len(greeting._framers) <= 32
    assert greeting.takes(heartbeat(1), ROVER, 1.0)


def test_where_this_program_spoke_first_only_that_address_is_heard() -> None:
    greeting = Greeting(ROVER)
    assert greeting.takes(b"anything", ROVER, 0.0)
    greeting.settle(1)
    assert not greeting.takes(heartbeat(1), STRANGER, 100.0)
    assert greeting.peer == ROVER


@pytest.mark.parametrize(
    ("have", "told"),
    [
        ({}, ""),
        ({"SYSID_MYGCS": 255.0}, ""),
        ({"MAV_GCS_SYSID": 255.0, "MAV_GCS_SYSID_HI": 0.0}, ""),
        ({"MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 255.0}, ""),
        ({"SYSID_MYGCS": 250.0}, "SYSID_MYGCS is 250: "),
        ({"MAV_GCS_SYSID": 245.0, "MAV_GCS_SYSID_HI": 0.0}, "MAV_GCS_SYSID is 245: "),
        ({"MAV_GCS_SYSID": 1.0, "MAV_GCS_SYSID_HI": 254.0}, "MAV_GCS_SYSID is 1 and MAV_GCS_SYSID_HI 254: "),
    ],
)
def test_ignored_overrides_are_named_with_the_parameter(have: dict[str, float], told: str) -> None:
    """By the parameters of both generations of firmware."""
    sentence = why_overrides_ignored(have)
    assert sentence.startswith(told)
    assert ("this one is 255" in sentence) == bool(told)
