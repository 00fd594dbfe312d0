"""Log download over a link that loses blocks."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from fake_vehicle import FakeVehicle

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle import log_download
from rover_sweep.vehicle.events import LogProgress, LogSaved
from rover_sweep.vehicle.link import Link
from rover_sweep.vehicle.log_download import MavlinkLogs


def test_byte_identical_although_blocks_are_lost(
    link: Link, vehicle: FakeVehicle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_download, "_QUIET", 0.05)
    chance = random.Random(3)
    vehicle.log = bytes(chance.randrange(256) for _ in range(100_003))
    vehicle.drop = lambda message: message.get_type() == "LOG_DATA" and chance.random() < 0.05
    logs = MavlinkLogs(link)
    (entry,) = logs.logs()
    events = list(logs.download(entry, tmp_path / "log1.BIN"))
    assert (tmp_path / "log1.BIN").read_bytes() == vehicle.log
    assert isinstance(events[-1], LogSaved)
    done = [event.done for event in events if isinstance(event, LogProgress)]
    assert done == sorted(done)
    assert done[-1] == 100_003


def test_a_log_that_stops_coming_is_told(
    link: Link, vehicle: FakeVehicle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_download, "_QUIET", 0.02)
    vehicle.log = b"x" * 1000
    vehicle.drop = lambda message: message.get_type() == "LOG_DATA" and message.ofs >= 450
    with pytest.raises(LinkError, match="log 1 stopped coming at 450 of 1000 bytes"):
        list(MavlinkLogs(link).download(MavlinkLogs(link).logs()[0], tmp_path / "log1.BIN"))
    assert not (tmp_path / "log1.BIN").exists()


def test_no_logs_and_armed(link: Link, vehicle: FakeVehicle) -> None:
    assert MavlinkLogs(link).logs() == ()
    vehicle.armed = True
    link.wait_for("HEARTBEAT", 2.0, lambda _: link.armed)
    with pytest.raises(LinkError, match="while the rover is armed"):
        MavlinkLogs(link).logs()


def test_a_folder_that_is_gone_is_told(link: Link, vehicle: FakeVehicle, tmp_path: Path) -> None:
    vehicle.log = b"x" * 100
    (entry,) = MavlinkLogs(link).logs()
    with pytest.raises(UsageError, match="gone/log1.BIN cannot be written .No such file or directory"):
        list(MavlinkLogs(link).download(entry, tmp_path / "gone" / "log1.BIN"))
