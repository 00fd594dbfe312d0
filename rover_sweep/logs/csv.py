"""Recordings of other origin: a .csv with a column map.

The map is a small TOML file (or a dictionary of the same form):

    time = "t"                                     # s
    pwm = "steer"                                  # us; or delta, the road-wheel angle, rad
    r = {column = "yaw_rate", unit = "deg/s"}      # p, ay, vy, speed, phi, psi, throttle likewise
    delta = {column = "steer", scale = 0.35}       # offset is subtracted first, then scale multiplies
    speed = 2.4                                    # a number where it was constant, m/s
    trial = "trial"                                # rows with another value are another recording
    runs = "whole"                                 # all driving of a trial is one run; else they are "found"
    leave_out = "bad"                              # rows where this column is true (or 1) are left out
    axes = "iso"                                   # or "frd": r, ay, vy, psi, delta change sign
    sampling = "smooth"                            # or "step": steering keeps its value until the next row
    filters = {gyro_hz = 20, accel_hz = 20}        # known low-pass filters, if any
"""

from __future__ import annotations

import csv
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.identify.recording import LowPass, Note, Signal
from rover_sweep.logs.log import Array, Log, increasing, source_of

UNITS = {"pwm": "us", "delta": "rad", "r": "rad/s", "p": "rad/s", "ay": "m/s^2", "vy": "m/s",
         "speed": "m/s", "phi": "rad", "psi": "rad", "throttle": "us"}  # fmt: skip
OPTIONS = {"time", "trial", "runs", "leave_out", "axes", "sampling", "filters"}
SIGN_CHANGES = {"r", "ay", "vy", "psi", "delta"}  # between FRD and ISO axes
FACTORS = {"deg": np.pi / 180, "deg/s": np.pi / 180, "mrad/s": 1e-3, "g": 9.80665, "ft/s": 0.3048,
           "ft/s^2": 0.3048, "km/h": 1 / 3.6, "ms": 1e-3, "s": 1.0}  # fmt: skip
THRUSTERS = [re.compile(rf"^(thr|thrust|throttle|thruster|motor)_?{side}(_|$)") for side in ("left", "right")]


@dataclass(frozen=True)
class Column:
    """Where a channel stands in the file: (value - offset) * scale is in the channel's unit."""

    name: str
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class ColumnMap:
    """A checked column map. constants: channels that are a number instead of a column."""

    time: Column
    columns: Mapping[str, Column]
    constants: Mapping[str, float]
    trial: str | None
    leave_out: str | None
    whole: bool
    frd: bool
    step: bool
    filters: Mapping[str, float]


def read_csv(path: Path, column_map: Mapping[str, Any] | str | None) -> tuple[Log, ...]:
    """A .csv as one `Log` for each trial.

    Without a map the columns must bear the channels' own names. Raises UsageError for a wrong map,
    DataRefused for a file that is empty, no table, or of a vehicle without steered wheels.
    """
    header, rows = _table(path)
    _refuse_thrusters(path, header)
    columns = parse_column_map(_loaded(column_map, header, path), header)
    table = {name: [row[i] for row in rows] for i, name in enumerate(header)}
    trials = np.array(table[columns.trial]) if columns.trial else np.zeros(len(rows), int)
    labels = list(dict.fromkeys(trials.tolist()))
    marked = _marked(table[columns.leave_out]) if columns.leave_out else np.zeros(len(rows), bool)
    source = source_of(path)
    needed = {c.name for c in (columns.time, *columns.columns.values())}
    numbers = {name: _numbers(path, name, table[name]) for name in needed}
    names = [f"{path.stem} {label}" if columns.trial else path.stem for label in labels]
    logs = []
    for name, label in zip(names, labels, strict=True):
        own = trials == label
        part = {column: values[own & ~marked] for column, values in numbers.items()}
        log = _log(name, part, columns, source)
        logs.append(replace(log, notes=log.notes + _left_out(columns, int(np.sum(own & marked)))))
    return tuple(logs)


def _marked(cells: list[str]) -> np.ndarray:
    """Which rows bear a mark (n,): true, yes or a number other than 0."""
    return np.array([cell.strip().lower() not in ("", "0", "0.0", "false", "no") for cell in cells])


def _left_out(columns: ColumnMap, count: int) -> tuple[Note, ...]:
    text = f"{count} rows marked in column {columns.leave_out} were left out"
    return (Note("warning", text),) if count else ()


def _table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a file separated by comma, semicolon or tab."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataRefused(f"{path.name} is no text: {error.reason} at byte {error.start}") from error
    first = text.partition("\n")[0]
    if not first.strip():
        raise DataRefused(f"{path.name} is empty: its first line must name the columns")
    delimiter = max(",;\t", key=first.count)
    header, *rows = list(csv.reader(text.splitlines(), delimiter=delimiter))
    header = [name.strip() for name in header]
    rows = [row for row in rows if row]
    short = next((i for i, row in enumerate(rows) if len(row) != len(header)), None)
    if short is not None:
        raise DataRefused(f"{path.name}: line {short + 2} has {len(rows[short])} of {len(header)} columns")
    if not rows:
        raise DataRefused(f"{path.name} has a header and no rows")
    return header, rows


def _numbers(path: Path, name: str, cells: list[str]) -> Array:
    try:
        return np.array([cell.strip() or "nan" for cell in cells]).astype(float)
    except ValueError as error:
        raise DataRefused(f"{path.name}: column {name} holds no numbers ({error})") from error


def _refuse_thrusters(path: Path, header: list[str]) -> None:
    pair = [next((n for n in header if side.match(n.lower())), None) for side in THRUSTERS]
    if all(pair):
        raise DataRefused(
            f"{path.name} comes from a vehicle without steered wheels: the columns {pair[0]} and {pair[1]} "
            "show differential thrust; only rovers with steered wheels can be identified"
        )


def _loaded(given: Mapping[str, Any] | str | None, header: list[str], path: Path) -> Mapping[str, Any]:
    if given is None:
        own = {n: n for n in (*UNITS, "trial") if n in header} | {"time": "t" if "t" in header else "time"}
        if own["time"] in header and len(own) > 2:
            return own
        raise UsageError(
            f"{path.name} needs a column map (a TOML file with time, pwm or delta, r, speed, ...); "
            f"its columns are {', '.join(header)}"
        )
    if not isinstance(given, str):
        return given
    try:
        return tomllib.loads(Path(given).read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{given}: the column map cannot be read ({error.strerror})") from error
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{given}: the column map is no TOML ({error})") from error


def parse_column_map(given: Mapping[str, Any], header: list[str]) -> ColumnMap:
    """Check a column map against the names of the columns. Raises UsageError."""
    unknown = set(given) - set(UNITS) - OPTIONS
    if unknown:
        raise UsageError(
            f"Column map: {', '.join(sorted(unknown))} is no channel; "
            f"known are {', '.join((*UNITS, *sorted(OPTIONS)))}"
        )
    missing = [name for name in ("time", "r", "speed") if name not in given]
    if missing or not {"pwm", "delta"} & set(given):
        missing += [] if {"pwm", "delta"} & set(given) else ["pwm or delta"]
        raise UsageError(f"Column map: {', '.join(missing)} is missing; the file has {', '.join(header)}")
    channels = {n: v for n, v in given.items() if n in UNITS}
    constants = {n: float(v) for n, v in channels.items() if isinstance(v, int | float)}
    for option in ("trial", "leave_out"):
        if (named := given.get(option)) is not None and named not in header:
            raise UsageError(f"Column map: {option} = {named!r}, but the columns are {', '.join(header)}")
    return ColumnMap(
        time=_column("time", given["time"], header),
        columns={n: _column(n, v, header) for n, v in channels.items() if n not in constants},
        constants=constants,
        trial=given.get("trial"),
        leave_out=given.get("leave_out"),
        whole=_choice(given, "runs", ("found", "whole")) == "whole",
        frd=_choice(given, "axes", ("iso", "frd")) == "frd",
        step=_choice(given, "sampling", ("smooth", "step")) == "step",
        filters=_filters(given.get("filters", {})),
    )


def _choice(given: Mapping[str, Any], key: str, allowed: tuple[str, str]) -> str:
    value = given.get(key, allowed[0])
    if value not in allowed:
        raise UsageError(f'Column map: {key} = {value!r}, it must be "{allowed[0]}" or "{allowed[1]}"')
    return str(value)


def _filters(given: Any) -> dict[str, float]:
    if not isinstance(given, Mapping) or not set(given) <= {"gyro_hz", "accel_hz"}:
        raise UsageError(f"Column map: filters = {given!r}, it must be {{gyro_hz = .., accel_hz = ..}} in Hz")
    return {name: float(value) for name, value in given.items()}


def _column(channel: str, given: Any, header: list[str]) -> Column:
    entry = {"column": given} if isinstance(given, str) else given
    if not isinstance(entry, Mapping) or not set(entry) <= {"column", "scale", "offset", "unit"}:
        raise UsageError(
            f'Column map: {channel} = {given!r}, it must be "name" or {{column, unit, scale, offset}}'
        )
    name = entry.get("column")
    if name not in header:
        raise UsageError(f"Column map: {channel} = {name!r}, but the columns are {', '.join(header)}")
    unit = entry.get("unit", UNITS.get(channel, "s"))
    if unit not in FACTORS and unit != UNITS.get(channel):
        raise UsageError(
            f"Column map: {channel} in {unit!r} is not known; use scale to get {UNITS.get(channel, 's')}"
        )
    return Column(
        name, float(entry.get("scale", 1.0)) * FACTORS.get(unit, 1.0), float(entry.get("offset", 0.0))
    )


def _log(name: str, numbers: Mapping[str, Array], columns: ColumnMap, source: tuple[str, str]) -> Log:
    time = (numbers[columns.time.name] - columns.time.offset) * columns.time.scale
    signals, notes = {}, list(_time_notes(time))
    for channel, column in columns.columns.items():
        sign = -1.0 if columns.frd and channel in SIGN_CHANGES else 1.0
        values = (numbers[column.name] - column.offset) * column.scale * sign
        signals[channel], note = _signal(channel, column.name, time, values, columns.step)
        notes += note
    whole = next(iter(signals.values())).t
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
        name=name, signals=signals, steering=steering, filters=filters, notes=tuple(notes),
        sources=(source,), whole=columns.whole,
    )  # fmt: skip


def _time_notes(time: Array) -> Iterator[Note]:
    known = time[np.isfinite(time)]
    if known.size < time.size:
        yield Note("warning", f"{time.size - known.size} rows have no time and were left out")
    late = int(np.sum(np.diff(known) <= 0))
    if late:
        yield Note("warning", f"{late} rows are not later than the row before and were left out")


def _signal(channel: str, column: str, time: Array, values: Array, step: bool) -> tuple[Signal, list[Note]]:
    good = np.isfinite(values) & np.isfinite(time)
    t, (x,) = increasing(time[good], values[good])
    lost = int(np.sum(np.isfinite(time)) - np.sum(good))
    notes = [
        Note("warning", f"{channel} (column {column}): {lost} of {time.size} rows are NaN and were left out")
    ]
    hold = channel == "throttle" or (step and channel in ("pwm", "delta"))
    return Signal(t, x, UNITS[channel], column, hold=hold), notes if lost else []
