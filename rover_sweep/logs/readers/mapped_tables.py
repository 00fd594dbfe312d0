"""The logs in a table of another system, by its column map; without one, by columns that are found."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, LowPass, Note, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import Log, increasing, refuse_disorder
from rover_sweep.logs.readers.column_map import (
    PATHS,
    UNITS,
    WITNESSES,
    Column,
    ColumnMap,
    StreamClock,
    course_rate,
    heading_of,
    local_metres,
    own_names,
    parse_column_map,
    rate_alone,
    read_column_map,
    slope,
)
from rover_sweep.logs.readers.date_times import is_number
from rover_sweep.logs.readers.tables import RecordedTable, TableStream, read_table

NEEDED = {"pwm", "delta", "r", "speed"}
SIGN_CHANGES = {"r", "ay", "vy", "psi", "delta"}  # between FRD and ISO axes
THRUSTERS = [re.compile(rf"^(thr|thrust|throttle|thruster|motor)_?{side}(_|$)") for side in ("left", "right")]


def read_mapped(paths: Sequence[Path], column_map: Mapping[str, Any] | str | None) -> tuple[Log, ...]:
    """One `Log` for each trial in a file, or in several files of one drive.

    Without a map the columns are those named like the channels, else those that `guess_columns` finds, with
    a note; {"time": {"rate": 100}} alone gives the rate of rows without a clock. UsageError for a wrong map,
    or where columns are missing, DataRefused for a file that is empty, not a table, or of a vehicle without
    steered wheels.
    """
    table = read_table(paths)
    header, name = table.header, table.name
    pair = [next((n for n in header if side.match(n.lower())), None) for side in THRUSTERS]
    if all(pair):
        raise DataRefused(
            f"{name} comes from a vehicle without steered wheels: the columns {pair[0]} and {pair[1]} "
            "show differential thrust. Only the lumped model applies: leave these columns out, and give the "
            "turning command as pwm, r, ay and p (docs/questions.md)"
        )
    given = read_column_map(column_map) if isinstance(column_map, str) else column_map
    rate = rate_alone(given)
    if (given is None or rate) and (rate or (given := own_names(header)) is None):
        from rover_sweep.logs.readers.guessed_columns import guess_columns

        guess = guess_columns(table, rate)
        given = guess.needed_map()
        notes = (*table.notes, Note("warning", guess.sentence()))
        table = replace(table, notes=notes, unsure=guess.unsure)
    columns = parse_column_map(given, header, all(s.time is not None for s in table.streams))
    twice = sorted(name for name in columns.used if header.count(name) > 1)
    if twice:
        raise DataRefused(f"{name} has {header.count(twice[0])} columns {twice[0]}; rename all but one")
    marks = [mark for mark in (columns.trial, columns.leave_out) if mark is not None]
    if not marks:
        everything = [np.ones(len(stream), bool) for stream in table.streams]
        return (_log(table.stem, table, everything, columns),)
    return _trials(table, columns, _marked_stream(table, columns, marks))


def _marked_stream(table: RecordedTable, columns: ColumnMap, marks: Sequence[str]) -> TableStream:
    """The stream of trial and leave_out; DataRefused where other columns are not of it."""
    marked = table.of(marks[0])
    other = sorted(name for name in columns.used if name not in marked)
    if other:
        raise DataRefused(
            f"{table.name}: {marks[0]} was not recorded with {other[0]}, so it cannot divide it; leave "
            "trial and leave_out away"
        )
    return marked


def _trials(table: RecordedTable, columns: ColumnMap, stream: TableStream) -> tuple[Log, ...]:
    def cells(column: str) -> list[str]:
        found = stream[column]
        return found if isinstance(found, list) else [f"{x:.9g}" for x in found]

    trials = np.array(cells(columns.trial) if columns.trial else [""] * len(stream))
    marked = np.zeros(len(stream), bool)
    if columns.leave_out:  # true, yes or a number other than 0
        no = ("", "0", "0.0", "false", "no")
        marked = np.array([cell.strip().lower() not in no for cell in cells(columns.leave_out)])
    logs = []
    for label in dict.fromkeys(trials.tolist()):
        own = trials == label
        rows = [own & ~marked if s is stream else np.ones(len(s), bool) for s in table.streams]
        log = _log(f"{table.stem} {label}" if columns.trial else table.stem, table, rows, columns)
        if count := int(np.sum(own & marked)):
            text = f"{count} rows marked in column {columns.leave_out} were left out"
            log = replace(log, notes=(*log.notes, Note("warning", text)))
        logs.append(log)
    return tuple(logs)


def _numbers(table: RecordedTable, column: str) -> Array:
    stream = table.of(column)
    found, cells = stream.numbers(column), stream[column]
    if found is None:
        row, cell = next((k, cell) for k, cell in enumerate(cells) if not is_number(cell))
        comma = "; write decimal points, not commas" if is_number(cell.replace(",", ".")) else ""
        raise DataRefused(
            f"{table.name}: column {column} is not numeric ({cell.strip()[:20]!r} in row {row + 1}){comma}"
        )
    return found


def _times(table: RecordedTable, stream: TableStream, clocks: Sequence[StreamClock]) -> tuple[Array, str]:
    """The time (n,) s of each row of a stream, and the words for it."""
    own = next((c for c in clocks if c.column and c.column.names[0] in stream), None)
    if own is None and stream.time is not None:
        return stream.time, "its stamps"
    if own is None or own.column is None:
        even = next((c for c in clocks if c.rate), None)
        if even is None:
            raise DataRefused(
                f"{table.name}: the column map gives no time for {stream.names[0]} and what was recorded "
                'with it; add it: time = ["one column", "another"]'
            )
        return np.arange(len(stream)) / even.rate, "even samples"
    name = own.column.names[0]
    if (dates := stream.times(name)) is not None:
        return dates, f"column {name}"
    time = (_numbers(table, name) - own.column.offset) * own.column.scale
    if own.nanoseconds:
        time = time + _numbers(table, own.nanoseconds) * 1e-9
    return time, f"column {name}"


def _values(table: RecordedTable, column: Column) -> Array:
    """(n, 1) in the channel's unit; of what is made of slopes, what these are of: (n, 1) or (n, 2)."""
    parts = [_numbers(table, name) for name in column.names]
    if column.made == "quaternion":
        parts = [heading_of(*parts)]
    scaled = [(part - column.offset) * column.scale for part in parts]
    match column.made:
        case "lat_lon":
            scaled = list(local_metres(*scaled))
        case "columns":
            scaled = [sum(weight * part for weight, part in zip(column.along, scaled, strict=True))]
    return np.stack(scaled, 1)


def _moved(t: Array, column: Column, parts: Sequence[Array], turns: bool) -> Array:
    """Speed (n,) m/s over the ground of a position or velocity, or how fast its course turns, rad/s."""
    vx, vy = parts if column.made == "velocity" else (slope(t, part) for part in parts)
    moved = course_rate(vx, vy, slope(t, vx), slope(t, vy)) if turns else np.hypot(vx, vy)
    return moved * np.sign(column.scale)


SELDOM = 0.4  # s between positions, from which the chord of a turn is no longer its path


def _apart(t: Array, parts: Sequence[Array]) -> float:
    """Usual time [s] between two positions."""
    changed = t[1:][np.any([np.diff(part) != 0 for part in parts], axis=0)]
    return float(np.median(np.diff(changed))) if changed.size > 1 else 0.0


def _is_seldom(t: Array, parts: Sequence[Array]) -> bool:
    return _apart(t, parts) > SELDOM


def _refuse_seldom(name: str, column: Column, t: Array, parts: Sequence[Array]) -> None:
    """DataRefused for positions that come too seldom for a speed in turns."""
    if _is_seldom(t, parts):
        apart = _apart(t, parts)
        raise DataRefused(
            f"{name}: the positions ({', '.join(column.names)}) come every {apart:.2g} s, too seldom for a "
            "speed in turns (4 a second are enough); give a column of the speed"
        )


def _log(name: str, table: RecordedTable, rows: Sequence[NDArray[np.bool_]], columns: ColumnMap) -> Log:
    """rows: for each stream a mask of the rows that are used."""
    signals: dict[str, Signal] = {}
    notes = list(table.notes)
    times: dict[int, Array] = {}
    for channel, column in columns.columns.items():
        stream = table.of(column.names[0])
        number = table.streams.index(stream)
        keep = rows[number]
        if number not in times:
            times[number] = _checked(name, _times(table, stream, columns.clocks), keep, notes)
        time, values = times[number], _values(table, column)[keep]
        good = np.isfinite(values).all(axis=1) & np.isfinite(time)
        t, parts = increasing(time[good], *values[good].T)
        x = parts[0]
        if column.made in ("heading", "quaternion"):
            x = np.unwrap(x) if channel == "psi" else slope(t, np.unwrap(x))
        elif column.made in PATHS and t.size:
            if channel in WITNESSES and _is_seldom(t, parts):
                continue
            _refuse_seldom(name, column, t, parts)
            x = _moved(t, column, parts, channel == "r")
        if columns.frd and channel in SIGN_CHANGES:
            x = -x
        if t.size:
            hold = channel == "throttle" or (columns.step and channel in ("pwm", "delta"))
            signals[channel] = Signal(t, x, UNITS[channel], column.source, hold, column.origin)
            if lost := int(np.sum(np.isfinite(time))) - int(np.sum(good)):
                text = f"{channel} (column {column.source}): {lost} of {time.size} rows are no finite number"
                notes.append(Note("warning", f"{text} and were left out"))
        elif channel in NEEDED:
            raise DataRefused(f"{name}: column {column.source} ({channel}) has no row with a finite number")
        else:
            notes.append(Note("warning", f"{channel} (column {column.source}) is empty and was left out"))
    if len(times) > 1:
        notes.append(_joined(name, list(times.values())))
    whole = max(signals.values(), key=lambda s: s.t.size).t
    for channel, value in columns.constants.items():
        signals[channel] = Signal(whole, np.full(whole.size, value), UNITS[channel], "column map")
    steering = tuple(signals.pop(c) for c in ("delta", "pwm") if c in signals)
    witnesses = {c: signals.pop(c) for c in WITNESSES & set(signals)}
    courses = columns.columns["r"].made in PATHS
    angle = "delta" not in columns.columns or columns.columns["delta"].unit != "full"
    unsure = (*table.unsure, *(() if angle else ("delta",)), *(("course",) if courses else ()))
    gyro, accel = (columns.filters.get(key, 0.0) for key in ("gyro_hz", "accel_hz"))
    filters = {
        c: LowPass(f, "column map")
        for c, f in (("r", gyro), ("p", gyro), ("ay", accel))
        if f and c in signals
    }
    return Log(
        name=name,
        unsure=unsure,
        signals=signals,
        steering=steering,
        filters=filters,
        notes=tuple(notes),
        sources=table.sources,
        whole=columns.whole,
        witnesses=witnesses,
    )


def _checked(name: str, timed: tuple[Array, str], keep: NDArray[np.bool_], notes: list[Note]) -> Array:
    """The kept times (n,) s, with notes on those that are missing or disordered."""
    time, words = timed[0][keep], timed[1]
    refuse_disorder(name, {words: time})
    known = time[np.isfinite(time)]
    if known.size > 1 and np.ptp(known) == 0:
        raise DataRefused(f"{name}: {words} (the time) has the same value in all rows")
    if known.size < time.size:
        notes.append(Note("warning", f"{time.size - known.size} rows have no time and were left out"))
    if late := int(np.sum(np.diff(known) <= 0)):
        notes.append(Note("warning", f"{late} rows are not later than the previous row and were left out"))
    return time


def _joined(name: str, times: Sequence[Array]) -> Note:
    """A note that several clocks were used; DataRefused where they have no time in common."""
    first, last = (f(g(t[np.isfinite(t)]) for t in times) for f, g in ((max, np.min), (min, np.max)))
    if first >= last:
        raise DataRefused(
            f"{name}: steering, yaw rate and speed were recorded at no common time by their clocks; "
            "are they of one drive, and the times in one unit?"
        )
    return Note(
        "info",
        f"the columns are of {len(times)} recordings with clocks of their own, joined by their times: each "
        f"keeps its samples, and they have {last - first:.0f} s in common",
    )
