"""Recordings of other systems: a .csv with a column map (see `column_map`)."""

from __future__ import annotations

import csv
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.data.recording import LowPass, Note, Recording, Signal
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.files.documents import read_toml
from rover_sweep.logs.log import Array, Log, increasing, refuse_disorder, source_of

# The column map of a .csv: which column holds which channel, in what unit.
#
# The map is a small TOML file (or a dictionary of the same form):
#
#     time = "t"                                     # s
#     pwm = "steer"                                  # us; or delta, the road-wheel angle, rad
#     r = {column = "yaw_rate", unit = "deg/s"}      # also p, ay, vy, speed, phi, psi, throttle
#     delta = {column = "steer", scale = 0.35}       # offset is subtracted first, then scale multiplies
#     speed = 2.4                                    # a number for a constant value, m/s
#     trial = "trial"                                # each value is one recording
#     runs = "whole"                                 # all driving of a trial is one run; default "found"
#     leave_out = "bad"                              # rows where this column is true (or 1) are left out
#     axes = "iso"                                   # or "frd": r, ay, vy, psi, delta change sign
#     sampling = "smooth"                            # or "step": steering keeps its value until the next row
#     filters = {gyro_hz = 20, accel_hz = 20}        # known low-pass filters, if any


UNITS = {
    "pwm": "us",
    "delta": "rad",
    "r": "rad/s",
    "p": "rad/s",
    "ay": "m/s^2",
    "vy": "m/s",
    "speed": "m/s",
    "phi": "rad",
    "psi": "rad",
    "throttle": "us",
    "servo": "us",
}
OPTIONS = {"time", "trial", "runs", "leave_out", "axes", "sampling", "filters"}
# Unit of a channel -> the units that it may be given in, and their factors
FACTORS: Mapping[str, Mapping[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "us": {"us": 1.0},
    "rad": {"rad": 1.0, "deg": math.pi / 180},
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "mrad/s": 1e-3},
    "m/s": {"m/s": 1.0, "km/h": 1 / 3.6, "ft/s": 0.3048},
    "m/s^2": {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "ft/s^2": 0.3048},
}


@dataclass(frozen=True)
class Column:
    """The column of a channel: (value - offset) * scale is in the channel's unit."""

    name: str
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class ColumnMap:
    """A checked column map. constants: {channel: value}; frd: FRD axes; step: steering is held."""

    time: Column
    columns: Mapping[str, Column]
    constants: Mapping[str, float]
    trial: str | None
    leave_out: str | None
    whole: bool
    frd: bool
    step: bool
    filters: Mapping[str, float]

    @property
    def used(self) -> set[str]:
        """Names of all columns that are read."""
        marks = {name for name in (self.trial, self.leave_out) if name is not None}
        return {c.name for c in (self.time, *self.columns.values())} | marks


def _loaded(given: Mapping[str, Any] | str | None, header: list[str], file_name: str) -> Mapping[str, Any]:
    """The map of a file with these columns: given, from a TOML file, or by columns named like channels."""
    if given is None:
        own = {n: n for n in (*UNITS, "trial") if n in header} | {"time": "t" if "t" in header else "time"}
        if own["time"] in header and len(own) > 2:
            return own
        raise UsageError(
            f"{file_name} needs a column map: write a TOML file that names the columns, with lines such as "
            'time = "t", delta = {column = "steer", unit = "deg"}, r = {column = "rate", unit = "deg/s"}, '
            'speed = "v" (all keys: docs/formats.md), and give it with --columns FILE; its columns are '
            f"{', '.join(header)}"
        )
    if not isinstance(given, str):
        return given
    try:
        return read_toml(Path(given).read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{given}: the column map cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise UsageError(
            f"{given}: the column map is not a text file ({error.reason} at byte {error.start})"
        ) from error
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{given}: the column map is not valid TOML ({error})") from error


def parse_column_map(given: Mapping[str, Any], header: list[str]) -> ColumnMap:
    """Checks a column map against the names of the columns; UsageError for mistakes."""
    unknown = set(given) - set(UNITS) - OPTIONS
    if unknown:
        raise UsageError(
            f"Column map: {', '.join(sorted(unknown))} is not known; "
            f"the keys are {', '.join((*UNITS, *sorted(OPTIONS)))}"
        )
    missing = [name for name in ("time", "r", "speed") if name not in given]
    if missing or not {"pwm", "delta"} & set(given):
        missing += [] if {"pwm", "delta"} & set(given) else ["pwm or delta"]
        raise UsageError(f"Column map: {', '.join(missing)} is missing; the file has {', '.join(header)}")
    channels = {n: v for n, v in given.items() if n in UNITS}
    constants = {n: _number(n, v) for n, v in channels.items() if isinstance(v, int | float)}
    lacking = [n for n in ("delta", "pwm", "r") if n in constants]
    if lacking:
        raise UsageError(
            f"Column map: {lacking[0]} = {channels[lacking[0]]!r}, it must be a column; "
            "a number is for a constant channel, such as speed"
        )
    for option in ("trial", "leave_out"):
        if (named := given.get(option)) is not None and named not in header:
            raise UsageError(f"Column map: {option} = {named!r}, but the columns are {', '.join(header)}")
    low_passes = given.get("filters", {})
    if not isinstance(low_passes, Mapping) or not set(low_passes) <= {"gyro_hz", "accel_hz"}:
        raise UsageError(
            f"Column map: filters = {low_passes!r}, it must be {{gyro_hz = .., accel_hz = ..}} in Hz"
        )
    filters = {name: _number(name, value) for name, value in low_passes.items()}
    for name, value in filters.items():
        if value < 0:
            raise UsageError(
                f"Column map: {name} = {value:g} Hz; a cut-off must be positive, or 0 for no filter"
            )
    return ColumnMap(
        time=_column("time", given["time"], header),
        columns={n: _column(n, v, header) for n, v in channels.items() if n not in constants},
        constants=constants,
        trial=given.get("trial"),
        leave_out=given.get("leave_out"),
        whole=_choice(given, "runs", ("found", "whole")) == "whole",
        frd=_choice(given, "axes", ("iso", "frd")) == "frd",
        step=_choice(given, "sampling", ("smooth", "step")) == "step",
        filters=filters,
    )


def _choice(given: Mapping[str, Any], key: str, allowed: tuple[str, str]) -> str:
    value = given.get(key, allowed[0])
    if value not in allowed:
        raise UsageError(f'Column map: {key} = {value!r}, it must be "{allowed[0]}" or "{allowed[1]}"')
    return str(value)


def _number(what: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UsageError(f"Column map: {what} = {value!r}, it must be a finite number")
    return float(value)


def _column(channel: str, given: Any, header: list[str]) -> Column:
    entry = {"column": given} if isinstance(given, str) else given
    if not isinstance(entry, Mapping) or not set(entry) <= {"column", "scale", "offset", "unit"}:
        raise UsageError(
            f'Column map: {channel} = {given!r}, it must be "name" or {{column, unit, scale, offset}}'
        )
    name = entry.get("column")
    if name not in header:
        raise UsageError(f"Column map: {channel} = {name!r}, but the columns are {', '.join(header)}")
    scale = _number(f"scale of {channel}", entry.get("scale", 1.0)) * _factor(channel, entry.get("unit"))
    if scale == 0 or (channel == "time" and scale < 0):
        wanted = "above 0" if channel == "time" else "another number"
        raise UsageError(f"Column map: scale of {channel} = {entry['scale']!r}, it must be {wanted}")
    return Column(name, scale, _number(f"offset of {channel}", entry.get("offset", 0.0)))


def _factor(channel: str, unit: Any) -> float:
    own = UNITS.get(channel, "s")
    if unit is not None and (not isinstance(unit, str) or unit not in FACTORS[own]):
        raise UsageError(
            f"Column map: the unit {unit!r} of {channel} is not known; use {', '.join(FACTORS[own])}, "
            f"or scale to {own}"
        )
    return FACTORS[own][unit or own]


# Removes impossible samples and constant channels with a note, or refuses the log.


# (lowest, highest) possible value in the channel's unit: full scale of all sensors in use (gyro 34.9 rad/s,
# accelerometer 16 or 30 g), servo pulses, rovers on wheels.
POSSIBLE: Mapping[str, tuple[float, float]] = {
    "r": (-40.0, 40.0),
    "p": (-40.0, 40.0),
    "ay": (-400.0, 400.0),
    "vy": (-100.0, 100.0),
    "speed": (-100.0, 100.0),
    "phi": (-2 * np.pi, 2 * np.pi),
    "psi": (-np.inf, np.inf),
    "throttle": (500.0, 2500.0),
    "servo": (500.0, 2500.0),
    "pwm": (500.0, 2500.0),
    "delta": (-np.pi / 2, np.pi / 2),
}
STEERING_WHEEL = 6 * np.pi  # rad, three turns to one side
OUTPUTS = ("pwm", "throttle")  # 0 us is an output that is switched off
OTHER_UNIT = {
    **dict.fromkeys(("r", "p"), "deg/s"),
    **dict.fromkeys(("delta", "phi"), "deg"),
}  # in which these channels are often written
IMPOSSIBLE_LIMIT = 0.01  # share of a channel's samples; above it the others are unreliable too
RESPONSES = ("r", "ay", "p", "vy")
FEWEST = 20  # samples of a channel in a run


def screened(log: Log, widest: float = POSSIBLE["delta"][1]) -> Log:
    """The log without samples that are not finite or impossible, with notes on them.

    widest: possible steering angle to either side, rad.
    Channels and steering outputs without samples are removed. DataRefused when more than 1 % of the samples
    of a channel are impossible.
    """
    notes: list[Note] = []
    limits = {**POSSIBLE, "delta": (-widest, widest)}
    signals = {name: _possible(log, name, s, limits[name], notes) for name, s in log.signals.items()}
    channels = ["delta" if s.unit == "rad" else "pwm" for s in log.steering]
    steering = [_possible(log, c, s, limits[c], notes) for c, s in zip(channels, log.steering, strict=True)]
    return replace(
        log,
        signals={name: s for name, s in signals.items() if s.t.size},
        steering=tuple(s for s in steering if s.t.size),
        notes=(*log.notes, *notes),
    )


def _possible(
    log: Log, channel: str, signal: Signal, limits: tuple[float, float], notes: list[Note]
) -> Signal:
    low, high = limits
    off = (signal.x == 0) & (channel in OUTPUTS)
    wrong: NDArray[np.bool_] = ~off & ~(np.isfinite(signal.x) & (signal.x >= low) & (signal.x <= high))
    count = int(wrong.sum())
    if count == 0 and not off.any():
        return signal
    if count:
        x = signal.x[wrong]
        finding = (
            f"{count} of {signal.x.size} samples of {channel} ({signal.source}) are impossible, "
            f"such as {x[int(np.argmax(np.abs(x)))]:.3g} {signal.unit}"
        )
        if count > 1 + IMPOSSIBLE_LIMIT * signal.x.size:
            raise DataRefused(f"{log.name}: {finding}; {_other_unit(channel, signal)}")
        notes.append(Note("warning", f"{finding}; they were left out"))
    keep = ~(wrong | off)
    return replace(signal, t=signal.t[keep], x=signal.x[keep])


def _other_unit(channel: str, signal: Signal) -> str:
    """What to do where most values of a channel are impossible."""
    unit = OTHER_UNIT.get(channel)
    if unit is None:
        other = f"or {channel} is in another unit"
        return f"the file is damaged, {other}: copy the log again, or convert the channel"
    column = signal.source.removeprefix("column ")
    return (
        f"are they in {unit}? For a .csv, give the unit in the column map: "
        f'{channel} = {{column = "{column}", unit = "{unit}"}}; else copy the log again'
    )


def without_dead_channels(run: Recording) -> Recording:
    """The run without lateral channels that are constant or have too few samples.

    DataRefused when this is the yaw rate, which every identification needs.
    """
    reasons = {}
    for c in (c for c in RESPONSES if c in run):
        signal = run.manoeuvre(c)
        if signal.t.size < FEWEST:
            reasons[c] = f"has only {signal.t.size} samples in the run"
        elif np.ptp(signal.x) == 0:
            reasons[c] = f"does not change ({signal.x[0] + 0.0:.4g} {signal.unit}): not recorded?"
    if "r" in reasons:
        raise DataRefused(f"{run.name}: r ({run['r'].source}) {reasons['r']}; record the yaw rate")
    if not reasons:
        return run
    left_out = tuple(Note("warning", f"{c} {reason}; it was left out") for c, reason in reasons.items())
    channels = {name: s for name, s in run.channels.items() if name not in reasons}
    return replace(run, channels=channels, notes=(*run.notes, *left_out))


NEEDED = {"pwm", "delta", "r", "speed"}
SIGN_CHANGES = {"r", "ay", "vy", "psi", "delta"}  # between FRD and ISO axes
THRUSTERS = [re.compile(rf"^(thr|thrust|throttle|thruster|motor)_?{side}(_|$)") for side in ("left", "right")]


def read_csv(path: Path, column_map: Mapping[str, Any] | str | None) -> tuple[Log, ...]:
    """A .csv as one `Log` for each trial.

    Without a map the columns must be named like the channels. UsageError for a wrong map, DataRefused for a
    file that is empty, not a table, or of a vehicle without steered wheels.
    """
    header, rows = _table(path)
    pair = [next((n for n in header if side.match(n.lower())), None) for side in THRUSTERS]
    if all(pair):
        raise DataRefused(
            f"{path.name} comes from a vehicle without steered wheels: the columns {pair[0]} and {pair[1]} "
            "show differential thrust. Only the lumped model applies: leave these columns out, and give the "
            "turning command as pwm, r, ay and p (docs/questions.md)"
        )
    columns = parse_column_map(_loaded(column_map, header, path.name), header)
    twice = sorted(name for name in columns.used if header.count(name) > 1)
    if twice:
        raise DataRefused(f"{path.name} has {header.count(twice[0])} columns {twice[0]}; rename all but one")
    table = {name: [row[i] for row in rows] for i, name in enumerate(header)}
    trials = np.array(table[columns.trial]) if columns.trial else np.zeros(len(rows), int)
    labels = list(dict.fromkeys(trials.tolist()))
    marked = np.zeros(len(rows), bool)
    if columns.leave_out:  # true, yes or a number other than 0
        no = ("", "0", "0.0", "false", "no")
        marked = np.array([cell.strip().lower() not in no for cell in table[columns.leave_out]])
    source = source_of(path)
    needed = {c.name for c in (columns.time, *columns.columns.values())}
    numbers = {name: _numbers(path, name, table[name]) for name in sorted(needed)}
    names = [f"{path.stem} {label}" if columns.trial else path.stem for label in labels]
    logs = []
    for name, label in zip(names, labels, strict=True):
        own = trials == label
        part = {column: values[own & ~marked] for column, values in numbers.items()}
        log = _log(name, part, columns, source)
        if count := int(np.sum(own & marked)):
            text = f"{count} rows marked in column {columns.leave_out} were left out"
            log = replace(log, notes=(*log.notes, Note("warning", text)))
        logs.append(log)
    return tuple(logs)


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


def _log(name: str, numbers: Mapping[str, Array], columns: ColumnMap, source: tuple[str, str]) -> Log:
    time = (numbers[columns.time.name] - columns.time.offset) * columns.time.scale
    refuse_disorder(name, {f"column {columns.time.name}": time})
    known = time[np.isfinite(time)]
    if known.size > 1 and np.ptp(known) == 0:
        raise DataRefused(f"{name}: column {columns.time.name} (the time) has the same value in all rows")
    signals, notes = {}, []
    if known.size < time.size:
        notes.append(Note("warning", f"{time.size - known.size} rows have no time and were left out"))
    if late := int(np.sum(np.diff(known) <= 0)):
        notes.append(Note("warning", f"{late} rows are not later than the previous row and were left out"))
    for channel, column in columns.columns.items():
        sign = -1.0 if columns.frd and channel in SIGN_CHANGES else 1.0
        values = (numbers[column.name] - column.offset) * column.scale * sign
        good = np.isfinite(values) & np.isfinite(time)
        t, (x,) = increasing(time[good], values[good])
        if t.size:
            hold = channel == "throttle" or (columns.step and channel in ("pwm", "delta"))
            signals[channel] = Signal(t, x, UNITS[channel], column.name, hold=hold)
            if lost := known.size - int(np.sum(good)):
                text = f"{channel} (column {column.name}): {lost} of {time.size} rows are no finite number"
                notes.append(Note("warning", f"{text} and were left out"))
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
