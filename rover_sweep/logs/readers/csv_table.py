"""Recordings of other systems: a .csv with a column map (see `column_map`)."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.data.recording import LowPass, Note, Signal
from rover_sweep.errors import DataRefused
from rover_sweep.logs.log import Array, Log, increasing, refuse_disorder, source_of
from rover_sweep.logs.readers.column_map import UNITS, ColumnMap, read_column_map

NEEDED = {"pwm", "delta", "r", "speed"}
SIGN_CHANGES = {"r", "ay", "vy", "psi", "delta"}  # between FRD and ISO axes
THRUSTERS = [re.compile(rf"^(thr|thrust|throttle|thruster|motor)_?{side}(_|$)") for side in ("left", "right")]


def read_csv(path: Path, column_map: Mapping[str, Any] | str | None) -> tuple[Log, ...]:
    """A .csv as one `Log` for each trial.

    Without a map the columns must be named like the channels. UsageError for a wrong map, DataRefused for a
    file that is empty, not a table, or of a vehicle without steered wheels.
    """
    header, rows = _table(path)
    _refuse_thrusters(path, header)
    columns = read_column_map(column_map, header, path.name)
    _refuse_twice(path, header, columns)
    table = {name: [row[i] for row in rows] for i, name in enumerate(header)}
    trials = np.array(table[columns.trial]) if columns.trial else np.zeros(len(rows), int)
    labels = list(dict.fromkeys(trials.tolist()))
    marked = _marked(table[columns.leave_out]) if columns.leave_out else np.zeros(len(rows), bool)
    source = source_of(path)
    needed = {c.name for c in (columns.time, *columns.columns.values())}
    numbers = {name: _numbers(path, name, table[name]) for name in sorted(needed)}
    names = [f"{path.stem} {label}" if columns.trial else path.stem for label in labels]
    logs = []
    for name, label in zip(names, labels, strict=True):
        own = trials == label
        part = {column: values[own & ~marked] for column, values in numbers.items()}
        log = _log(name, part, columns, source)
        logs.append(replace(log, notes=log.notes + _left_out(columns, int(np.sum(own & marked)))))
    return tuple(logs)


def _marked(cells: list[str]) -> np.ndarray:
    """Mask (n,) of the marked rows: true, yes or a number other than 0."""
    return np.array([cell.strip().lower() not in ("", "0", "0.0", "false", "no") for cell in cells])


def _left_out(columns: ColumnMap, count: int) -> tuple[Note, ...]:
    text = f"{count} rows marked in column {columns.leave_out} were left out"
    return (Note("warning", text),) if count else ()


def _table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a file separated by comma, semicolon or tab."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataRefused(f"{path.name} is not a text file: {error.reason} at byte {error.start}") from error
    first = text.partition("\n")[0]
    if not first.strip():
        raise DataRefused(f"{path.name} is empty: its first line must name the columns")
    delimiter = max(",;\t", key=first.count)
    try:
        header, *rows = list(csv.reader(text.splitlines(), delimiter=delimiter, strict=True))
    except csv.Error as error:  # after an open quote the rest of the file is one cell
        raise DataRefused(
            f"{path.name} is not a table of numbers ({error}); is a quote not closed?"
        ) from error
    header = [name.strip() for name in header]
    rows = [row for row in rows if row]
    short = next((i for i, row in enumerate(rows) if len(row) != len(header)), None)
    if short is not None:
        raise DataRefused(f"{path.name}: line {short + 2} has {len(rows[short])} of {len(header)} columns")
    if not rows:
        raise DataRefused(f"{path.name} has a header but no rows")
    return header, rows


def _numbers(path: Path, name: str, cells: list[str]) -> Array:
    try:
        return np.array([cell.strip() or "nan" for cell in cells]).astype(float)
    except ValueError:
        row, cell = next((k, cell) for k, cell in enumerate(cells) if not _is_number(cell))
        comma = "; write decimal points, not commas" if _is_number(cell.replace(",", ".")) else ""
        raise DataRefused(
            f"{path.name}: column {name} is not numeric ({cell.strip()[:20]!r} in row {row + 1}){comma}"
        ) from None


def _is_number(cell: str) -> bool:
    try:
        float(cell.strip() or "nan")
    except ValueError:
        return False
    return True


def _refuse_twice(path: Path, header: list[str], columns: ColumnMap) -> None:
    twice = sorted(name for name in columns.used if header.count(name) > 1)
    if twice:
        raise DataRefused(f"{path.name} has {header.count(twice[0])} columns {twice[0]}; rename all but one")


def _refuse_thrusters(path: Path, header: list[str]) -> None:
    pair = [next((n for n in header if side.match(n.lower())), None) for side in THRUSTERS]
    if all(pair):
        raise DataRefused(
            f"{path.name} comes from a vehicle without steered wheels: the columns {pair[0]} and {pair[1]} "
            "show differential thrust. Only the lumped model applies: leave these columns out, and give the "
            "turning command as pwm, r, ay and p (docs/questions.md)"
        )


def _log(name: str, numbers: Mapping[str, Array], columns: ColumnMap, source: tuple[str, str]) -> Log:
    time = (numbers[columns.time.name] - columns.time.offset) * columns.time.scale
    refuse_disorder(name, {f"column {columns.time.name}": time})
    known = time[np.isfinite(time)]
    if known.size > 1 and np.ptp(known) == 0:
        raise DataRefused(f"{name}: column {columns.time.name} (the time) has the same value in all rows")
    signals, notes = {}, list(_time_notes(time))
    for channel, column in columns.columns.items():
        sign = -1.0 if columns.frd and channel in SIGN_CHANGES else 1.0
        values = (numbers[column.name] - column.offset) * column.scale * sign
        signal, note = _signal(channel, column.name, time, values, columns.step)
        if signal.t.size:
            signals[channel], notes = signal, notes + note
        elif channel in NEEDED:
            raise DataRefused(f"{name}: column {column.name} ({channel}) has no row with a finite number")
        else:
            notes.append(Note("warning", f"{channel} (column {column.name}) is empty and was left out"))
    whole = max(signals.values(), key=lambda s: s.t.size).t
    for channel, value in columns.constants.items():
        signals[channel] = Signal(whole, np.full(whole.size, value), UNITS[channel], "column map")
    steering = tuple(signals.pop(c) for c in ("delta", "pwm") if c in signals)
    gyro, accel = (columns.filters.get(key, 0.0) for key in ("gyro_hz", "accel_hz"))
    filters = {
        c: LowPass(f, "column map")
        for c, f in (("r", gyro), ("p", gyro), ("ay", accel))
        if f and c in signals
    }
    return Log(
        name=name,
        signals=signals,
        steering=steering,
        filters=filters,
        notes=tuple(notes),
        sources=(source,),
        whole=columns.whole,
    )


def _time_notes(time: Array) -> Iterator[Note]:
    known = time[np.isfinite(time)]
    if known.size < time.size:
        yield Note("warning", f"{time.size - known.size} rows have no time and were left out")
    late = int(np.sum(np.diff(known) <= 0))
    if late:
        yield Note("warning", f"{late} rows are not later than the previous row and were left out")


def _signal(channel: str, column: str, time: Array, values: Array, step: bool) -> tuple[Signal, list[Note]]:
    good = np.isfinite(values) & np.isfinite(time)
    t, (x,) = increasing(time[good], values[good])
    lost = int(np.sum(np.isfinite(time)) - np.sum(good))
    notes = [
        Note(
            "warning",
            f"{channel} (column {column}): {lost} of {time.size} rows are no finite number and were left out",
        )
    ]
    hold = channel == "throttle" or (step and channel in ("pwm", "delta"))
    return Signal(t, x, UNITS[channel], column, hold=hold), notes if lost else []
