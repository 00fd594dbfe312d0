"""Log download over a link that loses blocks."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_vehicle import FakeVehicle

from rover_sweep.errors import LinkError, UsageError
from rover_sweep.vehicle import logs as download
from rover_sweep.vehicle.events import LogProgress, LogSaved
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.logs import LogEntry, MavlinkLogs, chosen_logs, settled


def test_byte_identical_although_blocks_are_lost(link, vehicle, tmp_path, monkeypatch):
    monkeypatch.setattr(download, "_QUIET", 0.2)
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


@pytest.mark.parametrize("lost", [0.0, 0.002])
def test_a_large_log_is_asked_for_at_once(link, vehicle, tmp_path, monkeypatch, lost):
    """And called off where something is lost, asked for, and gone on with."""
    monkeypatch.setattr(download, "_QUIET", 0.2)
    monkeypatch.setattr(download, "_WINDOW", 200 * 90)
    monkeypatch.setattr(download, "_LARGE", 400 * 90)
    chance = random.Random(4)
    vehicle.log = chance.randbytes(100_003)
    vehicle.drop = lambda message: message.get_type() == "LOG_DATA" and chance.random() < lost
    logs = MavlinkLogs(link)
    list(logs.download(logs.logs()[0], tmp_path / "log1.BIN"))
    assert (tmp_path / "log1.BIN").read_bytes() == vehicle.log
    asked = [(m.ofs, m.count) for m in vehicle.of_kind("LOG_REQUEST_DATA")]
    assert asked[0] == (0, 100_003) and (len(asked) == 1) == (lost == 0)
    rest = [(offset, count) for offset, count in asked if count > 200 * 90]
    assert all(offset % (200 * 90) == 0 and offset + count == 100_003 for offset, count in rest)


def test_the_latest_is_the_last_that_may_hold_a_drive() -> None:
    entries = tuple(LogEntry(n, size, 0) for n, size in enumerate((3_000_000, 1_700_000, 90_000, 10_000), 1))
    assert [e.number for e in chosen_logs(entries, "latest")] == [2]
    assert [e.number for e in chosen_logs(entries[2:], "latest")] == [4]
    assert [e.number for e in chosen_logs(entries, "4")] == [4] and chosen_logs(entries, "all") == entries


def test_a_log_that_still_grows_is_waited_for(link: Link) -> None:
    sizes = iter((1000, 2000, 2500, 2500, 9999))

    class Growing:
        def logs(self) -> tuple[LogEntry, ...]:
            return (LogEntry(1, next(sizes), 0),)

        def download(self, entry: LogEntry, path: Path) -> Iterator[LogProgress | LogSaved]:
            raise AssertionError

    assert [e.size for e in settled(link, Growing())] == [2500]


def test_a_log_that_stops_coming_is_told(link, vehicle, tmp_path, monkeypatch):
    monkeypatch.setattr(download, "_QUIET", 0.02)
    vehicle.log = b"x" * 1000
    vehicle.drop = lambda message: message.get_type() == "LOG_DATA" and message.ofs >= 450
    with pytest.raises(LinkError, match="the download of log 1 stopped at 450 of 1000 bytes"):
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
