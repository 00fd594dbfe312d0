"""MAVLink signing on the official firmware: its first port takes unsigned messages, its second does not."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from rover_sweep.errors import LinkError
from rover_sweep.vehicle.identity import identify_vehicle
from rover_sweep.vehicle.link.connection import Access
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import SigningKey, timestamp
from rover_sweep.vehicle.parameters import read_parameter
from sitl.launcher import start_ardurover

pytestmark = pytest.mark.ardurover

RIGHT, WRONG = SigningKey(bytes(range(32))), SigningKey(bytes(range(1, 33)))
DAY = 86_400.0  # s that the vehicle's time of signing is behind
SAVED = 4.0  # s until the key is at work on all ports, generously


@pytest.fixture(scope="module")
def ports(ardurover: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, str]]:
    """First and second port of a rover that was given the key."""
    folder = tmp_path_factory.mktemp("signing")
    with start_ardurover(ardurover, folder / "vehicle", variant=None) as rover:
        with Link.open(rover.connection, folder / "setup.tlog") as link:
            behind = timestamp(time.time() - DAY)
            link.to_vehicle("SETUP_SIGNING", secret_key=list(RIGHT.secret), initial_timestamp=behind)
            link.wait_for((), SAVED)
        host, _, port = rover.connection.rpartition(":")
        yield rover.connection, f"{host}:{int(port) + 2}"


def test_with_the_key_both_ports_answer(ports: tuple[str, str], tmp_path: Path) -> None:
    for url in ports:
        with Link.open(url, tmp_path / "a.tlog", access=Access(key=RIGHT)) as link:
            assert identify_vehicle(link).system == 1
            assert read_parameter(link, "SCHED_LOOP_RATE") == 50.0


def test_without_one_the_second_says_what_is_lacking(ports: tuple[str, str], tmp_path: Path) -> None:
    with Link.open(ports[0], tmp_path / "a.tlog") as link:
        assert identify_vehicle(link).system == 1
    with pytest.raises(LinkError, match="signs its messages and answers no unsigned ones; give the key"):
        Link.open(ports[1], tmp_path / "b.tlog")


def test_another_key_is_said_on_both(ports: tuple[str, str], tmp_path: Path) -> None:
    for url in ports:
        with pytest.raises(LinkError, match="signs with another key than that of --signing-key"):
            Link.open(url, tmp_path / "a.tlog", access=Access(key=WRONG))
