"""The day on which a log was recorded."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

from rover_sweep.logs.readers.dataflash import open_parts

GPS_BEGIN = datetime(1980, 1, 6, tzinfo=UTC)  # leap seconds do not matter for a day
FIRST, LAST = 2010, 2100  # years; a stamp outside is not a time
_IN_NAME = re.compile(r"(?<!\d)(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)(?!\d)")


def recorded_day(path: Path, name: str = "") -> tuple[str, str]:
    """(ISO date in UTC, where it is from): GPS or telemetry stamps, else the name, else the file's time.

    name: of the file where it was before, as in a URL. ("", "") for none.
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
