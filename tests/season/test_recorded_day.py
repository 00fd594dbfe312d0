"""The day of a log."""

from __future__ import annotations

import os
from datetime import date
from pathlib import Path

from rover_sweep.logs.read import recorded_day
from sitl.flash_log.dataflash_writer import DataFlashWriter
from sitl.flash_log.formats import FORMATS
from tests.season.drawn_fleet import gps_message


def flash(path: Path) -> Path:
    """A .BIN without a message but its formats."""
    with path.open("wb") as file:
        DataFlashWriter(file, FORMATS)
    return path


def testgps_message_time_comes_first(tmp_path: Path) -> None:
    path = flash(tmp_path / "2020-01-01.BIN")
    with path.open("ab") as file:
        file.write(gps_message(10.0, date(2026, 4, 12)))
    assert recorded_day(path) == ("2026-04-12", "GPS")


def test_the_name_comes_next(tmp_path: Path) -> None:
    path = flash(tmp_path / "2026-04-12 10-33-21.bin")
    assert recorded_day(path) == ("2026-04-12", "file name")
    assert recorded_day(path, "s3://fleet/20260413/7.BIN") == ("2026-04-13", "file name")
    assert recorded_day(path, "s3://fleet/7.BIN") == ("", "")


def test_a_telemetry_log_has_its_own_clock(tmp_path: Path) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes((1_775_000_000_000_000).to_bytes(8, "big") + b"\xfd")
    assert recorded_day(path) == ("2026-03-31", "telemetry")


def test_the_time_of_the_file_comes_last(tmp_path: Path) -> None:
    path = flash(tmp_path / "00000007.BIN")
    os.utime(path, (1_775_000_000, 1_775_000_000))
    assert recorded_day(path) == ("2026-03-31", "file time")
