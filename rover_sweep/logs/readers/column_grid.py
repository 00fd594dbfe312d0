"""The columns of an unknown table on a common grid, each with its slope, to be compared with each other."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from math import log, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, filtfilt

from rover_sweep.data.recording import Array
from rover_sweep.logs.log import increasing
from rover_sweep.logs.readers.column_map import FACTORS, heading_of, slope
from rover_sweep.logs.readers.column_names import is_degrees, name_weight, says_anything, unit_in, words_of
from rover_sweep.logs.readers.tables import FEWEST_ROWS, RecordedTable, TableStream

GRID_HZ, LONGEST = 20.0, 16_000  # of the common grid on which columns are compared; samples
SMOOTH_HZ = 2.0
MOST = 150  # columns of which all are compared; of more, those whose names say something
SHORTEST = 5.0  # s, of a recorded drive
EVERY = 5  # samples of the grid between two means


@dataclass(frozen=True)
class FoundColumn:
    """A line of the column map. channel: its key; entry: its value, None where it stays undecided.

    certainty: "certain", "likely" or "a guess". also: lines to write instead of it, as comments.
    """

    channel: str
    entry: Any
    certainty: str
    reason: str
    also: tuple[str, ...] = ()

    def lines(self) -> Iterator[str]:
        """Its text in the map."""
        yield f"# {self.certainty}: {self.reason}" if self.entry is not None else f"# {self.reason}"
        if self.entry is not None:
            yield f"{self.channel} = {toml_value(self.entry)}"
        yield from (f"# {line}" for line in self.also)


def toml_value(value: Any) -> str:
    """A value of the map as TOML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k} = {toml_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


Clock = tuple[Array, FoundColumn]
"""The time (n,) s of a stream, and its line of the map; without an entry, the file has stamps."""


def _clock(time: Array, entry: Any, certainty: str, reason: str) -> Clock:
    return time, FoundColumn("time", entry, certainty, reason)


def _clock_of(stream: TableStream) -> Clock | None:
    if stream.time is not None:
        return _clock(stream.time, None, "certain", "stamps of the file")
    found = [c for name in stream.names if (c := _as_clock(stream, name))]
    if not found:
        return None
    best, clock = max(found, key=lambda pair: pair[0])
    return clock


def _as_clock(stream: TableStream, name: str) -> tuple[float, Clock] | None:
    """(how well, the clock) of a column that may be the time."""
    weight = name_weight("time", name)
    if (t := stream.times(name)) is not None:
        if not _rises(t) or np.mean(np.diff(t[np.isfinite(t)]) > 0) < 0.05:  # of trials, or of whole seconds
            return None
        return 2.0 + weight, _clock(t, name, "certain", f"date-times, {_rate(t)}")
    x = stream.numbers(name)
    if x is None or not _rises(x):
        return None
    fine = next((n for n in stream.names if n != name and _is_nanoseconds(stream, n)), None)
    if fine is not None and np.all(x[np.isfinite(x)] % 1 == 0) and weight:
        t = x + np.asarray(stream.numbers(fine)) * 1e-9
        if _rises(t):
            words = f"seconds and nanoseconds, {_rate(t)}"
            return 2.0 + weight, _clock(t, {"column": name, "nanoseconds": fine}, "certain", words)
    steps = np.diff(x[np.isfinite(x)])
    if np.mean(steps > 0) < 0.02:  # whole seconds, of which the rest is in no column
        return None
    step = float(np.median(steps[steps > 0]))
    even = float(np.mean(np.abs(steps / step - 1) < 0.5))
    if not weight and (even < 0.8 or step == 1.0):  # a row number, or a distance
        return None
    unit, sure = _time_unit(name, x, step)
    t = x * FACTORS["s"][unit]
    entry = name if unit == "s" else {"column": name, "unit": unit}
    certainty = "certain" if weight and sure else "likely" if weight else "a guess"
    reason = f"it rises in {'even' if even > 0.9 else 'uneven'} steps, {_rate(t)}"
    reason += "" if unit == "s" else f" if it is in {unit}"
    return weight + 0.5 * even + 0.3 * float(np.mean(steps > 0)), _clock(t, entry, certainty, reason)


BLOCKS = 25, 100, 500  # samples, over which columns without a clock are compared


def _even_samples(stream: TableStream) -> Clock | None:
    """The rate of a stream without a clock, from two columns of which one is the other's integral."""
    columns = [(n, x) for n in stream.names if (x := stream.numbers(n)) is not None and np.ptp(x) > 0]
    whole = [(n, np.unwrap(x) if _period(x) else x) for n, x in columns if np.isfinite(x).all()]
    best = 0.95, 0.0, "", ""
    for (name, x), (other, y), block in product(whole, whole, BLOCKS):
        change = np.diff(x[::block])
        if name == other or change.size < FEWEST_ROWS:
            continue
        total = np.add.reduceat(_within(y), np.arange(0, y.size, block))[: change.size]
        step, share = relation(_within(change), total)
        if share > best[0] and 1e-4 < abs(step) < 1.0:
            best = share, abs(step) / sqrt(share), name, other
    share, step, name, other = best
    if not step:
        return None
    rate = float(f"{1 / step:.2g}")
    reason = f"no column is a clock; at {rate:g} Hz, {name} is the integral of {other}, in SI units"
    return _clock(np.arange(len(stream)) / rate, {"rate": rate}, "likely", reason)


def _is_nanoseconds(stream: TableStream, name: str) -> bool:
    if words_of(name).split()[-1:] not in (["ns"], ["nsec"], ["nsecs"], ["nanosec"], ["nanoseconds"]):
        return False
    x = stream.numbers(name)
    return x is not None and float(np.nanmin(x)) >= 0 and 1e6 < float(np.nanmax(x)) < 1e9


def _time_unit(name: str, x: Array, step: float) -> tuple[str, bool]:
    """(unit, whether it is certain) of a clock that rises by `step` from row to row."""
    last = float(np.nanmax(np.abs(x)))
    for unit, epoch in (("ns", 1e18), ("us", 1e15), ("ms", 1e12), ("s", 1e9)):
        if 0.6 * epoch < last < 4 * epoch and (unit != "s" or step < 10):
            return unit, True
    if (told := unit_in(name)) in FACTORS["s"]:
        return told, True
    span = float(np.nanmax(x) - np.nanmin(x))
    rates = {u: 1 / (step * f) for u, f in FACTORS["s"].items() if span * f > SHORTEST or u == "s"}
    possible = [unit for unit, rate in rates.items() if 0.5 <= rate <= 2500]
    best = min(rates, key=lambda unit: abs(log(rates[unit] / 50)))
    return best, possible == [best]


def _rises(x: Array) -> bool:
    """True for a column that grows from row to row, but for a few rows, and in all."""
    known = x[np.isfinite(x)]
    if known.size < max(FEWEST_ROWS, 0.5 * x.size):
        return False
    steps = np.diff(known)
    return bool(np.mean(steps >= 0) > 0.98 and known[-1] > known[0])


def _rate(t: Array) -> str:
    steps = np.diff(t[np.isfinite(t)])
    return f"{1 / float(np.median(steps[steps > 0])):.3g} Hz"


@dataclass(eq=False)
class ColumnGrid:
    """Columns (n,) on an even grid. raw: as recorded; x: smooth; dot: slopes, of angles without their wraps.

    period: {column: 2 pi or 360} of columns that jump by it. held: share of repeated samples. made: {title:
    entry in the map} of what is made of several columns. unchanged: constant columns, which are left out.
    mean, mean_dot: x and dot as `means`.
    """

    raw: dict[str, Array] = field(default_factory=dict)
    x: dict[str, Array] = field(default_factory=dict)
    dot: dict[str, Array] = field(default_factory=dict)
    period: dict[str, float] = field(default_factory=dict)
    held: dict[str, float] = field(default_factory=dict)
    stream: dict[str, int] = field(default_factory=dict)
    clocks: dict[int, Clock] = field(default_factory=dict)
    made: dict[str, dict[str, Any]] = field(default_factory=dict)
    unchanged: list[str] = field(default_factory=list)
    mean: dict[str, Array] = field(default_factory=dict)
    mean_dot: dict[str, Array] = field(default_factory=dict)

    def make(self, title: str, entry: dict[str, Any], like: str, x: Array, dot: Array | None = None) -> None:
        """A column that is made of others, with samples (n,) on the grid; of the stream of one of them."""
        self.made[title], self.stream[title], self.raw[title], self.x[title] = entry, self.stream[like], x, x
        self.held[title], self.mean[title] = 0.0, means(x)
        self.dot[title] = np.gradient(x) * GRID_HZ if dot is None else dot
        self.mean_dot[title] = means(self.dot[title])

    def add(self, name: str, t: Array, x: Array, grid: Array, number: int) -> None:
        """A column with its times."""
        period = _period(x)
        whole = np.unwrap(x, period=period) if period else x
        self.stream[name] = number
        if period:
            self.period[name] = period
        self.held[name] = float(np.mean(np.diff(x) == 0))
        self.raw[name] = x
        self.x[name] = _smooth(np.interp(grid, t, whole))
        self.dot[name] = _smooth(np.interp(grid, t, slope(t, whole)))
        self.mean[name], self.mean_dot[name] = means(self.x[name]), means(self.dot[name])


def _period(x: Array) -> float:
    """2 pi or 360 of an angle that wraps in this column, 0 for another column."""
    jumps, wide = np.abs(np.diff(x)), float(np.ptp(x))
    for period in (2 * pi, 360.0):
        near = jumps > 0.9 * period
        if wide <= 1.01 * period and near.any() and near.sum() < 0.05 * x.size:
            return period
    return 0.0


def _smooth(x: Array) -> Array:
    """Low-passed, without jumps such as those of a simulator that places its vehicle anew."""
    if x.size < 20:
        return x
    return np.asarray(filtfilt(*butter(2, SMOOTH_HZ, fs=GRID_HZ), _within(x)))


def _within(x: Array) -> Array:
    """Clipped to three times the range that 99 % of the values are in."""
    low, high = np.percentile(x, (0.5, 99.5))
    return np.clip(x, 2 * low - high, 2 * high - low) if high > low else x


def gridded(table: RecordedTable) -> ColumnGrid:
    """The columns of numbers that change, on one grid over the time that most of them have in common."""
    found = ColumnGrid()
    columns: list[tuple[str, Array, Array, int]] = []
    clocks = {n: c for n, stream in enumerate(table.streams) if (c := _clock_of(stream))}
    if not clocks:
        longest = max(range(len(table.streams)), key=lambda n: len(table.streams[n]))
        clocks = {longest: c} if (c := _even_samples(table.streams[longest])) else {}
    twice = {name for name in table.header if table.header.count(name) > 1}
    crowded = len(table.header) > MOST
    for number, clock in clocks.items():
        found.clocks[number] = clock
        (time, line), stream = clock, table.streams[number]
        of_clock = _names_in(line.entry)
        numbers: dict[str, Array] = {}
        for name in stream.names:
            if name in of_clock or name in twice or (crowded and not says_anything(name)):
                continue
            x = stream.numbers(name)
            if x is None or np.isfinite(x).sum() < FEWEST_ROWS:
                continue
            numbers[name] = x
            good = np.isfinite(x) & np.isfinite(time) & (np.abs(x) < 1e12) & ~(is_degrees(name) & (x == 0))
            t, (kept,) = increasing(time[good], x[good])
            if t.size >= FEWEST_ROWS and (np.ptp(kept) > 0 or name_weight("speed", name) > 0.5):
                columns.append((name, t, kept, number))
            else:
                found.unchanged.append(name)
        columns += list(_quaternions(numbers, time, number, found))
    if not columns:
        return found
    first, last = np.median([t[0] for _, t, _, _ in columns]), np.median([t[-1] for _, t, _, _ in columns])
    grid = np.arange(first, last, 1 / GRID_HZ)[:LONGEST]
    for name, t, x, number in columns:
        inside = (t >= first) & (t <= last)
        if inside.sum() >= FEWEST_ROWS and t[-1] - t[0] > 0.5 * (last - first) and grid.size > 20:
            found.add(name, t, x, grid, number)
    return found


def _names_in(entry: Any) -> set[str]:
    return {entry} if isinstance(entry, str) else set(entry.values()) if isinstance(entry, dict) else set()


def _quaternions(
    numbers: dict[str, Array], time: Array, number: int, found: ColumnGrid
) -> Iterator[tuple[str, Array, Array, int]]:
    """The heading of any four columns in a row whose squares have the sum 1."""
    after = 0
    for k in range(len(numbers) - 3):
        names = list(numbers)[k : k + 4]
        if k < after:
            continue
        total = sum(np.square(numbers[name]) for name in names)
        if not np.nanmedian(np.abs(total - 1)) < 0.01 or np.nanstd(total) > 0.05:
            continue
        if words_of(names[0]).split()[-1] in ("w", "0", "qw", "q0"):
            names = [*names[1:], names[0]]
        psi = heading_of(*(numbers[name] for name in names))
        good = np.isfinite(psi) & np.isfinite(time)
        t, (kept,) = increasing(time[good], psi[good])
        if t.size >= FEWEST_ROWS and np.ptp(kept) > 0.1:
            after = k + 4
            title = f"quaternion {names[0]} to {names[3]}"
            found.made[title] = {"quaternion": names}
            yield title, t, np.unwrap(kept), number


def relation(y: Array, x: Array, use: NDArray[np.bool_] | None = None) -> tuple[float, float]:
    """(k, share of the variance of y) of y = k x + constant, without the 2 % that fit worst."""
    y, x = (y, x) if use is None else (y[use], x[use])
    if y.size < 20:
        return 0.0, 0.0
    k, offset, _ = _line(y, x)
    error = np.abs(y - k * x - offset)
    good = error <= np.percentile(error, 98)
    k, _, share = _line(y[good], x[good])
    return k, share


def means(x: Array) -> Array:
    """Means over a second, four each second: of what is noisy, as a slope is."""
    return np.asarray(uniform_filter1d(x, round(GRID_HZ))[::EVERY])


def _line(y: Array, x: Array) -> tuple[float, float, float]:
    """(k, offset, share of the variance of y) of y = k x + offset."""
    dx, dy = x - x.mean(), y - y.mean()
    xx, yy, xy = float(dx @ dx), float(dy @ dy), float(dx @ dy)
    if xx <= 0 or yy <= 0:
        return 0.0, float(y.mean()), 0.0
    return xy / xx, float(y.mean() - xy / xx * x.mean()), xy * xy / (xx * yy)
