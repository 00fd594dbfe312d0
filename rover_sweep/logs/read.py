"""Reads the runs of a recording, given its name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.data.recording import Recording
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.logs.cross_check import cross_checked
from rover_sweep.logs.find import find_runs
from rover_sweep.logs.judgement import refuse_unexcited, refuse_useless, with_notes
from rover_sweep.logs.log import Log
from rover_sweep.logs.readers.dataflash import open_parts
from rover_sweep.logs.readers.dataflash_channels import read_dataflash
from rover_sweep.logs.readers.mapped_tables import read_mapped
from rover_sweep.logs.readers.screening import STEERING_WHEEL, screened
from rover_sweep.logs.readers.tables import TABLES, is_table_file
from rover_sweep.logs.readers.tlog_channels import read_telemetry
from rover_sweep.logs.readers.vehicle_clock import paired


def read_runs(
    source: str,
    *,
    column_map: Mapping[str, Any] | str | None = None,
    filters: Mapping[str, float] | None = None,
    system: int | None = None,
) -> tuple[Recording, ...]:
    """All runs in a recording, in SI units and ISO axes, with notes on their quality.

    source: path of a .BIN, .tlog or table (`readers.tables`), or several of one drive joined by +:
    "log.BIN+log.tlog" (merged on the vehicle's clock), or tables. column_map: of a table, see
    `readers.column_map`. filters: {"gyro_hz",
    "accel_hz"} [Hz, 0 = off] that replace the recorded INS_GYRO_FILTER and INS_ACCEL_FILTER.
    system: MAVLink id of the vehicle in a .tlog that holds several.
    UsageError for a source that cannot be opened, DataRefused for one that cannot be used.
    """
    runs: list[Recording] = []
    refusals: list[DataRefused] = []
    with np.errstate(invalid="ignore", over="ignore"):  # damaged numbers are removed next
        logs = read_logs(source, column_map=column_map, filters=filters, system=system)
    for whole in logs:
        try:
            runs += runs_of(whole)
        except DataRefused as refusal:  # of one trial or one start of the vehicle; others may be usable
            refusals.append(refusal)
    if not runs and refusals:
        raise refusals[0]
    return tuple(runs)


def runs_of(whole: Log) -> tuple[Recording, ...]:
    """All runs of one log, with notes on their quality. DataRefused when none can be used."""
    log = usable_log(whole)
    found = find_runs(log)
    if not found:
        refuse_unexcited(log)
    return tuple(with_notes(run, log) for run in found)


def usable_log(whole: Log, steering_wheel: bool = False) -> Log:
    """The log without impossible samples; DataRefused where it can hold no driving of a rover.

    steering_wheel: the steering angle may be that of a steering wheel.
    """
    log = screened(whole, STEERING_WHEEL) if steering_wheel else screened(whole)
    refuse_useless(log)
    return cross_checked(log)


def read_logs(
    source: str,
    *,
    column_map: Mapping[str, Any] | str | None = None,
    filters: Mapping[str, float] | None = None,
    system: int | None = None,
) -> tuple[Log, ...]:
    """The logs in a source: several if the vehicle restarted or a table holds several trials."""
    parts = [source] if Path(source).exists() else source.split("+")
    if len(parts) == 2 and not all(is_table_file(Path(part)) for part in parts):
        return _pair(parts[0], parts[1], filters, system)
    paths = [existing_log(part) for part in parts]
    if all(is_table_file(path) for path in paths):
        return read_mapped(paths, column_map)
    path = paths[0]
    match path.suffix.lower() if len(paths) == 1 else "":
        case ".bin":
            return read_dataflash(path, filters)
        case ".tlog":
            return read_telemetry(path, filters, system)
    raise UsageError(f"{path.name}: {path.suffix or 'no extension'} cannot be read; give {READ}")


READ = f"a .BIN, .tlog, {TABLES}"


def _pair(
    first: str, second: str, filters: Mapping[str, float] | None, system: int | None
) -> tuple[Log, ...]:
    """Both logs of one drive, in either order."""
    by_kind = {path.suffix.lower(): path for path in (existing_log(first), existing_log(second))}
    if set(by_kind) != {".bin", ".tlog"}:
        raise UsageError(f"{first}+{second}: give one .BIN and one .tlog of the same drive")
    telemetry = read_telemetry(by_kind[".tlog"], filters, system)
    found, refusals = [], []
    for flash in read_dataflash(by_kind[".bin"], filters):
        try:
            found.append(paired(flash, telemetry))
        except DataRefused as refusal:  # of one log in a joined .BIN; others may be usable
            refusals.append(refusal)
    if not found:
        raise refusals[0]
    return tuple(found)


def existing_log(name: str) -> Path:
    """The path; UsageError for a missing file, and for a folder that is no ROS bag."""
    path = Path(name).expanduser()
    if path.is_dir() and not is_table_file(path):
        raise UsageError(f"{name} is a folder; give the path of {READ} in it")
    if not path.exists():
        raise UsageError(f"{name}: there is no such file; give the path of {READ}")
    return path


# The day on which a log was recorded.


GPS_BEGIN = datetime(1980, 1, 6, tzinfo=UTC)  # leap seconds do not matter for a day
FIRST, LAST = 2010, 2100  # years; a stamp outside is not a time
_IN_NAME = re.compile(r"(?<!\d)(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)(?!\d)")


def recorded_day(path: Path, name: str = "") -> tuple[str, str]:
    """(ISO date in UTC, where it is from): GPS or telemetry stamps, else the name, else the file's time.

    name: original name of the file, as in a URL. ("", "") if unknown.
    """
    stamp = {".bin": _of_flash, ".tlog": _of_telemetry}.get(path.suffix.lower(), lambda p: None)(path)
    if stamp is not None and FIRST <= stamp.year < LAST:
        return stamp.date().isoformat(), "telemetry" if path.suffix.lower() == ".tlog" else "GPS"
    if found := _in_name(name or str(path)):
        return found, "file name"
    if name:
        return "", ""  # the time of a copy says nothing
    changed = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    return changed.date().isoformat(), "file time"


def _of_flash(path: Path) -> datetime | None:
    """Time of the first GPS message with a fix."""
    for flash in open_parts(path):
        if flash.has("GPS", "GMS", "GWk"):
            rows = flash.rows("GPS")
            known = rows[rows["GWk"] > 0]
            if known.size:
                week, ms = int(known["GWk"][0]), int(known["GMS"][0])
                return GPS_BEGIN + timedelta(weeks=week, milliseconds=ms)
    return None


def _of_telemetry(path: Path) -> datetime | None:
    """Stamp of the first message: microseconds since 1970, big-endian."""
    with path.open("rb") as file:
        head = file.read(8)
    seconds = int.from_bytes(head, "big") / 1e6
    if len(head) < 8 or seconds > 4e9:
        return None
    return datetime.fromtimestamp(seconds, UTC)


def _in_name(name: str) -> str:
    """The last date in a path such as "rover-3/2026-04-12 10-33-21.bin", "" for none."""
    for year, month, day in reversed(_IN_NAME.findall(name)):
        try:
            return datetime(int(year), int(month), int(day), tzinfo=UTC).date().isoformat()
        except ValueError:
            continue
    return ""
