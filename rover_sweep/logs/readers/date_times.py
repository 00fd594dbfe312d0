"""Cells of a text table: numbers, date-times and times of day."""

from __future__ import annotations

import re

import numpy as np

from rover_sweep.data.recording import Array

SHOWN = 20  # cells that show whether a column holds date-times


def is_number(cell: str) -> bool:
    """True for a number, and for an empty cell."""
    try:
        float(cell.strip() or "nan")
    except ValueError:
        return False
    return True


def is_value(cell: str) -> bool:
    """True for a number or a date with a time of day, existing or not; an empty cell is none."""
    return bool(cell.strip()) and (is_number(cell) or _STAMP.match(cell) is not None)


_DATE = r"(?:(?P<day>\d{4}\D\d{1,2}\D\d{1,2}|\d{1,2}\D\d{1,2}\D\d{4})[T\s_,-]+)?"
_STAMP = re.compile(rf"\s*{_DATE}(?P<h>\d{{1,2}})[:_-](?P<m>\d\d)[:_-](?P<s>\d\d)(?:[.,_:](?P<f>\d+))?")


class NoSuchTime(ValueError):
    """A cell that is written like a date-time, and is none. why: a clause; row: from 1, below the header."""

    def __init__(self, cell: str, why: str, row: int = 0) -> None:
        super().__init__(why)
        self.cell, self.why, self.row = cell, why, row


def seconds_of(cell: str) -> float | None:
    """Seconds of a date-time such as 2024-04-23 13:34:01.638, or of a time of day; None for anything else.

    They count from the date 1970-01-01, without a time zone. ValueError for a date, or a time after a date,
    that does not exist; second 60 is a leap second. Hours without a date may be those since a start.
    """
    found = _STAMP.match(cell)
    if not found:
        return None
    hours, minutes, seconds = int(found["h"]), int(found["m"]), int(found["s"])
    clock = 3600 * hours + 60 * minutes + seconds
    possible = minutes < 60 and seconds <= 60
    fraction = float(f"0.{found['f']}") if found["f"] else 0.0
    if not found["day"]:
        return clock + fraction if possible else None
    if not possible or clock > 86400:  # 24:00:00 exists, and the leap second before it
        raise NoSuchTime(cell, f"there is no time {found['h']}:{found['m']}:{found['s']}")
    return 86400.0 * _day(cell, found["day"]) + clock + fraction


def _day(cell: str, text: str) -> int:
    """Days since 1970 of year-month-day, day-month-year or month-day-year; 0 for a clock without a date."""
    parts = [int(part) for part in re.split(r"\D", text)]
    if not any(parts):
        return 0
    year_first = re.match(r"\d{4}", text) is not None
    year, month, date = parts if year_first else (parts[2], parts[1], parts[0])
    if month > 12 and not year_first:
        month, date = date, month
    try:
        return int(np.datetime64(f"{year:04d}-{month:02d}-{date:02d}").astype(int))
    except ValueError:
        raise NoSuchTime(cell, f"there is no date {text}") from None


def times_of(cells: list[str]) -> Array | None:
    if not any(map(_STAMP.match, cells[:SHOWN])):
        return None
    if any(cell.strip() and not _STAMP.match(cell) for cell in cells):
        return None
    found = np.full(len(cells), np.nan)
    for k, cell in enumerate(cells):
        try:
            seconds = seconds_of(cell)
        except NoSuchTime as wrong:
            raise NoSuchTime(wrong.cell, wrong.why, k + 1) from None
        if seconds is None and cell.strip():
            return None
        found[k] = np.nan if seconds is None else seconds
    return found
