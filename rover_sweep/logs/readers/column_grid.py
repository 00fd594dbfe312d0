"""The columns of an unknown table on a common grid, each with its slope, to be compared with each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice, product
from math import log, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, filtfilt

from rover_sweep.data.recording import Array
from rover_sweep.logs.log import increasing
from rover_sweep.logs.readers.column_lines import FoundColumn
from rover_sweep.logs.readers.column_map import FACTORS, heading_of, slope
from rover_sweep.logs.readers.column_names import (
    SAYS,
    is_arrival,
    is_degrees,
    name_odds,
    name_weight,
    says_anything,
    unit_in,
    words_of,
)
from rover_sweep.logs.readers.tables import FEWEST_ROWS, RecordedTable, TableStream

MOST_CLOCKS, MOST_TRIED = 3, 100  # clocks of a stream, and sets of one for each stream, that are tried
LATE = 0.5  # of a weight, by which a time of arrival is a worse clock than a stamp of the measurement
GRID_HZ, LONGEST = 20.0, 16_000  # of the common grid on which columns are compared; samples
SMOOTH_HZ = 2.0
MOST = 150  # columns of which all are compared; of more, those whose names say something
SHORTEST = 5.0  # s, of a recorded drive
SAMPLES, ALL = 6.0, 0.02  # independent samples of a relation; share that any relation leaves out
EVERY = 5  # samples of the grid between two means


Clock = tuple[Array, FoundColumn]
"""The time (n,) s of a stream, and its line of the map; without an entry, the file has stamps."""


def _clock(time: Array, entry: Any, certainty: str, reason: str) -> Clock:
    return time, FoundColumn("time", entry, certainty, reason)


def _clocks_of(stream: TableStream) -> list[Clock]:
    """The columns that may be the clock of a stream, best first: stamps of measurements before arrivals."""
    if stream.time is not None:
        return [_clock(stream.time, None, "certain", "stamps of the file")]
    found = [c for name in stream.names if (c := _as_clock(stream, name))]
    return [clock for _, clock in sorted(found, key=lambda pair: -pair[0])[:MOST_CLOCKS]]


def _common_clocks(streams: Sequence[TableStream]) -> dict[int, Clock]:
    """The best clock of each stream that has one, of those by which all streams have a time in common."""
    tried = {n: clocks for n, stream in enumerate(streams) if (clocks := _clocks_of(stream))}
    chosen = {n: clocks[0] for n, clocks in tried.items()}
    for clocks in islice(product(*tried.values()), MOST_TRIED if tried else 0):
        known = [t[np.isfinite(t)] for t, _ in clocks]
        if max(t[0] for t in known) < min(t[-1] for t in known):
            return dict(zip(tried, clocks, strict=True))
    return chosen


def _as_clock(stream: TableStream, name: str) -> tuple[float, Clock] | None:
    """(how well, the clock) of a column that may be the time."""
    weight = name_weight("time", name) - LATE * is_arrival(name)
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
    arrived = "; it is the time of arrival or of the export, as no stamp of the measurement fits"
    reason += arrived if is_arrival(name) else ""
    return weight + 0.5 * even + 0.3 * float(np.mean(steps > 0)), _clock(t, entry, certainty, reason)


BLOCK = 25  # rows, over which columns without a clock are compared
NOMINAL_HZ = 50.0  # of rows without a clock, where nothing suggests their rate: only shapes are compared then
AGREE = 0.2  # of a rate, by which two suggestions of it may differ


def even_clock(rows: int, rate: float) -> Clock:
    """Even samples at a rate [Hz] that was given."""
    return _clock(np.arange(rows) / rate, {"rate": rate}, "certain", "as given")


def _suggested_rates(stream: TableStream) -> Iterator[tuple[float, str]]:
    """(rate [Hz], why) of a stream without a clock: a guess, as its columns may be in any unit.

    A heading is the integral of a yaw rate, and a position that of a speed, if their names say so.
    """
    x = {n: x for n in stream.names if (x := stream.numbers(n)) is not None and np.isfinite(x).all()}
    x = {n: values for n, values in x.items() if np.ptp(values) > 0 and values.size >= FEWEST_ROWS * BLOCK}
    turning, moving = (max(x, key=lambda n: name_weight(role, n), default="") for role in ("r", "speed"))
    heading = max(x, key=lambda n: name_weight("psi", n), default="")
    if heading and name_weight("psi", heading) >= 0.6 and name_weight("r", turning) >= 0.3:
        period = _period(x[heading])
        psi = np.unwrap(x[heading], period=period) if period else x[heading]
        if rate := _integrated(np.diff(psi[::BLOCK]), x[turning]):
            yield rate, f"{heading} is the integral of {turning}"
    places = [next((n for n in x if words_of(n).split()[-1:] == [axis]), "") for axis in "xy"]
    if all(places) and name_weight("speed", moving) >= 0.5:
        way = np.hypot(*(np.diff(x[n][::BLOCK]) for n in places))
        if rate := _integrated(way, np.abs(x[moving])):
            yield rate, f"{', '.join(places)} moves as {moving} says"


def _integrated(change: Array, slope_of_it: Array) -> float:
    """Rate [Hz] of rows: change (m,) is that in blocks of what slope_of_it (n,) is the slope of; 0 if not."""
    total = np.add.reduceat(slope_of_it, np.arange(0, slope_of_it.size, BLOCK))[: change.size]
    use = np.ones(change.size, bool)
    share = step = 0.0
    for _ in range(10):  # without the blocks with spikes or jumps
        step, offset, share = _line(change[use], total[use])
        error = np.abs(change - step * total - offset)
        use = error <= 4 * np.median(error[use]) + 1e-12
    return float(f"{sqrt(share) / abs(step):.2g}") if share > 0.9 else 0.0


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
    mean, mean_dot: x and dot as `means`. clockless: no column is a clock, and no rate was given. timed: False
    where the scale of the time is unknown, and with it that of every slope. suggested: (rate [Hz], why),
    guesses for rows without a clock.
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
    clockless: bool = False
    timed: bool = True
    suggested: list[tuple[float, str]] = field(default_factory=list)
    mean: dict[str, Array] = field(default_factory=dict)
    mean_dot: dict[str, Array] = field(default_factory=dict)

    def make(self, title: str, entry: dict[str, Any], like: str, x: Array, dot: Array | None = None) -> None:
        """A column that is made of others, with samples (n,) on the grid; of the stream of one of them."""
        self.made[title], self.stream[title], self.raw[title], self.x[title] = entry, self.stream[like], x, x
        self.held[title], self.mean[title] = 0.0, means(x)
        self.dot[title] = np.gradient(x) * GRID_HZ if dot is None else dot
        self.mean_dot[title] = means(self.dot[title])

    def odds(self, role: str, name: str) -> float:
        """Logarithm of the odds that a column has this role, by its name; one not so named is one of many."""
        return name_odds(role, name) - (log(len(self.dot)) if name_weight(role, name) < SAYS else 0.0)

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


def gridded(table: RecordedTable, rate: float = 0.0) -> ColumnGrid:
    """The columns of numbers that change, on one grid over the time that most of them have in common.

    rate: of the rows [Hz], where no column is their clock; 0 if it is unknown.
    """
    found = ColumnGrid()
    columns: list[tuple[str, Array, Array, int]] = []
    clocks = {} if rate else _common_clocks(table.streams)
    if not clocks:
        longest = max(range(len(table.streams)), key=lambda n: len(table.streams[n]))
        stream = table.streams[longest]
        found.suggested = [] if rate else list(_suggested_rates(stream))
        rates = [hz for hz, _ in found.suggested]
        found.clockless = not rate
        found.timed = bool(rate) or bool(rates and max(rates) < (1 + AGREE) * min(rates))
        clocks = {longest: even_clock(len(stream), rate or (rates[0] if found.timed else NOMINAL_HZ))}
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


def fit_odds(share: float) -> float:
    """Logarithm of the odds for a relation between two columns that explains this share of the variance.

    As of SAMPLES independent samples, since drives repeat themselves; ALL is of noise and physics that every
    relation leaves out.
    """
    return -0.5 * SAMPLES * log(1 - min(max(share, 0.0), 1.0) + ALL)


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
