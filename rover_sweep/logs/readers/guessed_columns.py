"""Finds the columns of an unknown table: what is time, steering, yaw rate, speed and accelerations.

Names propose, physics decides: the yaw rate is the slope of the heading and of the course over ground, the
speed is the slope of the position, V r is the lateral acceleration, and the yaw rate follows V times the
steering. These relations also give units and signs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import acos, degrees, sqrt
from typing import Any

import numpy as np

from rover_sweep.data.results import NORMAL_90
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.logs.log import disorder
from rover_sweep.logs.readers.column_grid import EVERY, GRID_HZ, ColumnGrid, gridded, means, relation
from rover_sweep.logs.readers.column_lines import FoundColumn, certainty_of, column_entry, toml_value
from rover_sweep.logs.readers.column_map import FACTORS, UNITS
from rover_sweep.logs.readers.column_names import is_another, is_rotation, name_weight, says_nothing, unit_in
from rover_sweep.logs.readers.joint_columns import joint_columns
from rover_sweep.logs.readers.motion_columns import (
    LINK,
    SPEED_UNITS,
    UNRECORDED,
    WEAK,
    MotionColumns,
    acceleration_units,
    direction,
    other_speed,
    yaw_rate_of,
)
from rover_sweep.logs.readers.steering_columns import NAMED, steering_lines, steering_unit, usual_speed
from rover_sweep.logs.readers.tables import FEWEST_ROWS, RecordedTable

PART = 6.0  # s, parts of a drive in which a speed that was not recorded is compared
SAME_SPEED = 0.2  # share by which it may change and still count as constant
BLOCK = 5.0  # s, beyond which what a scale is fitted to counts as independent


@dataclass(frozen=True)
class ColumnGuess:
    """What was found in a table. missing: what the map needs and was not found.

    obstacle: what no map can mend, such as too few rows; "" for none.
    """

    table: str
    found: tuple[FoundColumn, ...]
    missing: tuple[str, ...] = ()
    obstacle: str = ""

    @property
    def map(self) -> dict[str, Any]:
        """The column map of all that was found."""
        return {line.channel: line.entry for line in self.found if line.entry is not None}

    def needed_map(self) -> dict[str, Any]:
        """The column map; UsageError where a needed column was not found, DataRefused where none can be."""
        if self.missing and self.obstacle:
            raise DataRefused(f"{self.table}: {self.obstacle}")
        if self.missing == ("time",):
            raise UsageError(
                f"{self.table} has no clock: {self.found[0].reason}. Give the rate of its rows with --rate HZ"
            )
        if self.missing:
            raise UsageError(
                f"{self.table} needs a column map: no column was found for {', '.join(self.missing)}; write "
                f"a map to complete with `rover-sweep columns {self.table} --out columns.toml`, and give it "
                "with --columns columns.toml (all keys: docs/formats.md)"
            )
        return self.map

    @property
    def unsure(self) -> tuple[str, ...]:
        """Channels whose unit is a guess."""
        return tuple(
            f.channel for f in self.found if f.channel in ("r", "speed") and f.also and f.entry is not None
        )

    def sentence(self) -> str:
        """What was taken for what, and how to correct it."""
        taken = ", ".join(f"{k} = {toml_value(v)}" for k, v in self.map.items())
        units = f"; the unit of {' and of '.join(self.unsure)} is not certain" if self.unsure else ""
        no_angle = '"full"' in toml_value(self.map.get("delta", ""))
        units += "; delta is no angle, its unit is full steering" if no_angle else ""
        return (
            f"columns of {self.table}, found by their names and values: {taken}{units}; to correct them, "
            f"write the map with `rover-sweep columns`, and give it with --columns"
        )

    def text(self) -> str:
        """The column map as TOML, with a reason for each line."""
        return "\n".join(line for found in self.found for line in found.lines()) + "\n"


def guess_columns(table: RecordedTable, rate: float = 0.0) -> ColumnGuess:
    """The roles of a table's columns, each with its certainty and reasons.

    rate: of the rows [Hz], where no column is their clock; 0 if it is unknown.
    """
    grid = gridded(table, rate)
    joint = joint_columns(grid)
    motion, tried = joint.motion, joint.steering
    found: list[FoundColumn] = []
    missing: list[str] = []
    if motion.r and motion.speed:
        name, share, gain = (tried[0].name, tried[0].share, tried[0].gain) if tried else ("", 0.0, 0.0)
        speed = usual_speed(grid, motion)
        angle = share > 0.2 and steering_unit(grid, name, gain, speed)[0] == "delta"
        back = direction(grid, motion, gain if angle else 0.0)
        steering = list(steering_lines(grid, motion, tried, joint.why, back[0]))
        steered = any(s.channel in ("delta", "pwm") and s.certainty == "certain" for s in steering)
        found += [*_motion_lines(grid, motion, steered, back), *steering, *_other_lines(grid, motion, name)]
        found = [_with_others(line, joint.others.get(line.channel, ())) for line in found]
        if motion.r.startswith("path ") and share < WEAK:  # of positions that are too coarse
            words = f"follows V times the steering to {100 * share:.0f} % only: the positions are too coarse"
            reason = f"not found: yaw rate; how fast the course over ground turns {words}"
            found = [replace(f, entry=None, reason=reason) if f.channel == "r" else f for f in found]
        if table.name.endswith(".ulg") and not motion.turned:
            found.append(FoundColumn("axes", "frd", "certain", "PX4 logs forward, right and down"))
    else:
        found += _named_lines(grid)
    for channels, title in ((("delta", "pwm"), "steering"), (("r",), "yaw rate"), (("speed",), "speed")):
        if not any(line.channel in channels and line.entry is not None for line in found):
            missing.append(title)
            if not any(line.channel in channels for line in found):
                found.append(_undecided(channels[0], title, table))
    clock = _clock_lines(grid, table, found)
    if clock.entry is None and clock.certainty != "certain":
        missing.insert(0, "time")
    first = [] if clock.entry is None and clock.certainty == "certain" else [clock]
    return ColumnGuess(
        table.name, (*first, *found, *_mark_lines(table, grid)), tuple(missing), _obstacle(table, grid)
    )


def _with_others(line: FoundColumn, names: Sequence[str]) -> FoundColumn:
    """The line with other columns that fit alike."""
    entry = line.entry
    if entry is None or not names:
        return line
    rest = {k: v for k, v in entry.items() if k in ("unit", "scale")} if isinstance(entry, Mapping) else {}
    lines = (f"{line.channel} = {toml_value(column_entry(n, '', '', rest))}  # fits alike" for n in names)
    return replace(line, alike=tuple(lines))


def _named_lines(grid: ColumnGrid) -> Iterator[FoundColumn]:
    """What names alone say, where the yaw rate or the speed that would confirm them is missing."""
    for channel, role in (("r", "r"), ("speed", "speed"), ("delta", "steering"), ("ay", "ay")):
        names = [n for n in grid.dot if n not in grid.made and not is_another(role, n)]
        name = max(names, key=lambda n: name_weight(role, n), default="")
        if not name or name_weight(role, name) < NAMED:
            continue
        more: Mapping[str, Any] = {}
        if role == "steering":
            channel, more, words = steering_unit(grid, name, 0.0)
        else:
            told = unit_in(name)
            words = f"unit {told or 'undecided'}"
            more = {"unit": told} if told in FACTORS[UNITS[channel]] and told != UNITS[channel] else {}
        reason = f"its name; no other channel of the file confirms it; {words}"
        yield FoundColumn(channel, column_entry(name, "", "", more), "likely", reason)


def _obstacle(table: RecordedTable, grid: ColumnGrid) -> str:
    """What must change in the files before their columns can be found, "" for nothing."""
    longest = max(len(stream) for stream in table.streams)
    if longest < FEWEST_ROWS:
        return f"it has only {longest} {'row' if longest == 1 else 'rows'}; at least {FEWEST_ROWS} are needed"
    twice = [name for name in table.header if table.header.count(name) > 1]
    if twice:
        return f"it has {table.header.count(twice[0])} columns {twice[0]}; rename all but one"
    known = [] if grid.clockless else [t[np.isfinite(t)] for t, _ in grid.clocks.values()]
    if len(known) > 1 and max(t[0] for t in known) >= min(t[-1] for t in known):
        return (
            "its parts were recorded at no common time by their clocks; are they of one drive, and the times "
            "in one unit?"
        )
    for name in (n for n in table.header if grid.clockless and name_weight("time", n) >= 0.6):
        dates = table.of(name).times(name)
        t = table.of(name).numbers(name) if dates is None else dates
        if t is not None and (back := disorder(f"column {name}", t)):
            return back
    named = [n for n in table.header if name_weight("speed", n) >= 0.5]
    zero = [n for n in named if (x := table.of(n).numbers(n)) is not None and not np.any(x)]
    if zero and zero == named:
        return f"the vehicle stands still: {zero[0]} is 0 in all rows"
    for role in ("steering", "r"):
        named = [n for n in table.header if name_weight(role, n) >= NAMED]
        if named and set(named) <= set(grid.unchanged):
            return f"{named[0]} does not change"
    return ""


def _undecided(channel: str, title: str, table: RecordedTable) -> FoundColumn:
    names = ", ".join(dict.fromkeys(table.header)) if len(table.header) <= 60 else "many columns"
    return FoundColumn(channel, None, "", f"not found: {title}; the file has {names}", (f'{channel} = "?"',))


def _clock_lines(grid: ColumnGrid, table: RecordedTable, found: Sequence[FoundColumn]) -> FoundColumn:
    """The line of the time: of every recording whose columns are used."""
    used = {name for line in found if line.entry is not None for name in _named(line.entry)}
    numbers = [n for n, s in enumerate(table.streams) if used & set(s.names) and n in grid.clocks]
    clocks = [grid.clocks[n][1] for n in numbers or list(grid.clocks)[:1]]
    own = [c for c in clocks if c.entry is not None]
    if grid.clockless:
        return _no_clock(grid)
    if not own:
        return FoundColumn("time", None, "certain", "stamps of the file")
    entry = own[0].entry if len(own) == 1 else [c.entry for c in own]
    reason = "; ".join(dict.fromkeys(c.reason for c in own))
    weakest = max((c.certainty for c in own), key=("certain", "likely", "a guess").index)
    return FoundColumn("time", entry, weakest, reason)


def _no_clock(grid: ColumnGrid) -> FoundColumn:
    """The line of the time of rows without a clock: what suggests their rate is a guess, and is not used."""
    reason = "no column rises evenly like a clock"
    if not grid.suggested:
        return FoundColumn("time", None, "", reason, ("time = {rate = ?}  # Hz, of even samples",))
    words = ", and ".join(f"at {rate:g} Hz, {why}" for rate, why in grid.suggested)
    guess = "a guess" if grid.timed else "two guesses that disagree"
    reason = f"{reason}; {guess}: {words}, if these are in SI units"
    lines = tuple(f"time = {{rate = {rate:g}}}  # Hz, a guess" for rate, _ in grid.suggested)
    return FoundColumn("time", None, "", reason, lines)


def _named(entry: Any) -> set[str]:
    """Names of columns in an entry of the map."""
    if isinstance(entry, str):
        return {entry}
    if isinstance(entry, Mapping):
        return {n for k, v in entry.items() if k not in ("unit", "scale", "offset") for n in _named(v)}
    return {n for part in entry for n in _named(part)} if isinstance(entry, list) else set()


def _motion_lines(
    grid: ColumnGrid, motion: MotionColumns, steered: bool, back: tuple[bool, str]
) -> Iterator[FoundColumn]:
    """Lines of the yaw rate, the speed and the accelerations. steered: the steering is certain with these.

    back: `direction` of the drive.
    """
    links, units = motion.links, motion.units
    made = motion.r == motion.heading
    of = grid.made.get(motion.r, {})
    reasons = [] if made or of or name_weight("r", motion.r) < 0.3 else ["its name"]
    if "along" in of:
        tilt = degrees(acos(min(1.0, abs(of["along"][2]))))
        reasons.append(f"gravity's mean direction is up: the sensor's z is {tilt:.0f} deg off it")
    if motion.r.startswith("path "):
        reasons.append(
            "no gyro and no heading was found, so it is how fast the course over ground turns: early by the "
            "distance from the rear axle to the antenna over the speed, and blurred in quick turns"
        )
    elif made:
        reasons.append("no gyro was found, so it is the slope of the heading")
    if "heading" in links:
        reasons.append(f"its integral is the heading {motion.heading} ({_share(links['heading'])})")
    if "course" in links:
        reasons.append(f"the course over ground turns with it ({_share(links['course'])})")
    if links.get("V r", (0, 0))[1] > WEAK:
        reasons.append(f"V r is the lateral acceleration {_plain(grid, motion.ay)} ({_share(links['V r'])})")
    if steered:
        reasons.append("it follows the steering")
    unit = units["r"]
    scale = {"scale": -1} if motion.turned else {}
    if motion.turned:
        reasons.append("sign changed, as the course turns against it: left is positive")
    known = motion.sure > 1 or unit_in(motion.r) == unit
    reasons.append(f"unit {unit}" + ("" if known else ", not certain"))
    if made and motion.r in grid.made:
        entry: Any = {**grid.made[motion.r], **scale}
    elif made:
        entry = {"heading": motion.r, **({"unit": "deg"} if unit == "deg/s" else {}), **scale}
    else:
        entry = column_entry(of or motion.r, unit, "rad/s", scale)
    sure = len(reasons) - 1 - motion.turned
    other = "deg/s" if unit == "rad/s" else "rad/s"
    also = (
        (f"r = {toml_value(column_entry(of or motion.r, other, '', scale))}",) if not (known or made) else ()
    )
    yield FoundColumn("r", entry, certainty_of(sure if known else min(sure, 2)), "; ".join(reasons), also)

    yield _speed_line(grid, motion, steered, back)
    if motion.ay:
        k, share = links["V r"]
        sign = {"scale": -1} if ((k < 0) != motion.turned) != back[0] else {}
        mounted = grid.made.get(motion.ay)
        entry = column_entry(mounted or motion.ay, units["ay"], "m/s^2", sign)
        words = f"V r explains {100 * share:.0f} % of it{', sign changed to that of V r' if sign else ''}"
        turned = ", of all directions across gravity the one that fits" if mounted else ""
        level = name_weight("ay", motion.ay) or says_nothing(motion.ay)
        words += turned or ("" if level else ", so the sensor is mounted turned")
        if share < WEAK:
            reason = f"not decided: {motion.ay} is named like the lateral acceleration, but {words}"
            yield FoundColumn("ay", None, "", reason, (f"ay = {toml_value(entry)}",))
        elif len(possible := acceleration_units(grid, motion)) > 1:
            also = (column_entry(mounted or motion.ay, unit, "m/s^2", sign) for unit in possible)
            reason = f"{words}; its unit is undecided: {' or '.join(possible)}"
            yield FoundColumn("ay", None, "", reason, tuple(f"ay = {toml_value(each)}" for each in also))
        else:
            yield FoundColumn("ay", entry, "certain" if share > LINK else "likely", f"{words}; {units['ay']}")


def _speed_line(
    grid: ColumnGrid, motion: MotionColumns, steered: bool, back: tuple[bool, str]
) -> FoundColumn:
    name, links, unit = motion.speed, motion.links, motion.units["speed"]
    made = grid.made.get(name, {})
    k, share = links.get("V r", (0.0, 0.0))
    if made.get("scale") == 0:
        turns = made["column"]
        words = f"{turns} are revolutions, and neither a position nor a_y over r gives their scale"
        also = f"speed = {{column = {toml_value(turns)}, scale = ?}}  # m/s each; wheel in rpm: 2 pi R/60"
        return FoundColumn("speed", None, "", f"not found: speed; {words}", (also,))
    if name == UNRECORDED:
        return _no_speed(grid, motion)
    reasons = ["its name"] if name_weight("speed", name) >= 0.3 and not made else []
    if "column" in made:
        by, scale = "position" if "position" in links else "V r", made["scale"]
        half = NORMAL_90 * sqrt((1 / links[by][1] - 1) / max(grid.x[name].size / GRID_HZ / BLOCK, 1.0))
        by = {"position": "the position's slope", "V r": "a_y over r"}[by]
        low, high = sorted((scale * (1 - half), scale * (1 + half)))
        reasons += [f"revolutions, scaled by {by}: {scale:.3g} ({low:.3g} to {high:.3g}) m/s each"]
    elif made:
        reasons += ["made of two columns, as no speed was found"]
    elif "position" in links and links["position"][1] > 0.5:
        reasons.append(f"it is the slope of the position {motion.position} ({_share(links['position'])})")
    if share > WEAK:
        reasons.append(f"times the yaw rate it is {_plain(grid, motion.ay)}")
    if steered:
        reasons.append("times the steering it is the yaw rate")
    sure = motion.sure > 1 or bool(made) or unit_in(name) == unit
    sign = {"scale": -1} if (np.median(grid.x[name]) < 0) != back[0] else {}
    reasons += [back[1]] if back[1] else []
    also = [f"speed = {toml_value({'column': name, 'unit': u})}" for u in SPEED_UNITS if u != unit]
    if "column" in made and "position" not in links:
        less = toml_value({**made, "scale": 0.9 * made["scale"]})
        sure, also = False, [f"speed = {less}  # if a_y has 10 % of roll in it"]
    whole = {**made, "scale": made.get("scale", 1.0) * sign.get("scale", 1)} if made and sign else made
    entry = whole or column_entry(name, unit, "m/s", sign)
    words = "; ".join([*reasons, f"unit {unit}" + ("" if sure else ", not certain")])
    return FoundColumn(
        "speed", entry, certainty_of(len(reasons) - bool(back[1])), words, () if sure else tuple(also)
    )


def _no_speed(grid: ColumnGrid, motion: MotionColumns) -> FoundColumn:
    """The line of a speed that was not recorded. a_y over the yaw rate proposes one if it stays the same."""
    reason = "not found: speed; where it was constant, write its number in m/s"
    k, share = motion.links.get("V r", (0.0, 0.0))
    unknown = FoundColumn("speed", None, "", reason, ("speed = ?",))
    if share < WEAK:
        return unknown
    to_si = FACTORS["m/s^2"][motion.units["ay"]] / FACTORS["rad/s"][motion.units["r"]]
    low, middle, high = (abs(ratio) * to_si for ratio in _ratios(grid, motion, k))
    if high > (1 + SAME_SPEED) * low:
        words = f"{motion.ay} over the yaw rate says that it varied, {low:.3g} to {high:.3g} m/s"
        return replace(unknown, reason=f"not found: speed; {words}: a column of it is needed")
    own = FACTORS["m/s^2"][motion.units["ay"]]
    found = [(f"{middle * FACTORS['m/s^2'][u] / own:.3g}", u) for u in acceleration_units(grid, motion)]
    says = " or ".join(f"{speed} if it is in {unit}" for speed, unit in found)
    reason = f"{reason}; {motion.ay} over the yaw rate says {says}"
    return replace(unknown, reason=reason, also=tuple(f"speed = {speed}  # {unit}" for speed, unit in found))


def _ratios(grid: ColumnGrid, motion: MotionColumns, k: float) -> tuple[float, float, float]:
    """Tenth percentile, median and ninetieth of a_y over the yaw rate in parts of the drive."""
    r, ay = means(yaw_rate_of(grid, motion)), grid.mean[motion.ay]
    size = round(PART * GRID_HZ / EVERY)
    parts = [slice(n, n + size) for n in range(0, r.size - size + 1, size)]
    turning = np.median([np.ptp(r[part]) for part in parts]) if parts else 0.0
    found = [relation(ay[part], r[part]) for part in parts if np.ptp(r[part]) >= turning]
    slopes = [abs(each) for each, share in found if share > LINK]
    low, middle, high = np.percentile(slopes, (10, 50, 90)) if len(slopes) > 2 else (k, k, k)
    return float(low), float(middle), float(high)


def _plain(grid: ColumnGrid, name: str) -> str:
    """The column, or those it is made of."""
    return ", ".join(grid.made[name]["columns"]) if "along" in grid.made.get(name, {}) else name


def _share(found: tuple[float, float]) -> str:
    return f"{100 * found[1]:.0f} %"


# Everything else


def _other_lines(grid: ColumnGrid, motion: MotionColumns, steering: str) -> Iterator[FoundColumn]:
    """Roll rate from the gyro of the yaw rate; comments on what the map has no use for."""
    columns = [n for n in grid.dot if n not in grid.made and n != motion.r]
    same = [n for n in columns if grid.stream[n] == grid.stream[motion.r]]
    recorded = motion.speed in grid.mean and motion.speed not in grid.made
    for name in (n for n in columns if recorded and is_rotation(n)):
        k, share = relation(grid.mean[motion.speed], grid.mean[name])
        if share > LINK:
            other = {"column": name, "scale": float(f"{k * FACTORS['m/s'][motion.units['speed']]:.4g}")}
            words = f"revolutions that follow the speed ({100 * share:.0f} %)"
            yield FoundColumn("speed", None, "", words, (f"speed = {toml_value(other)}",))
    if (other := other_speed(grid, motion, steering)) is not None:
        words = f"moves as the speed says ({100 * other[1]:.0f} %): only to compare the speed with"
        yield FoundColumn("path_speed", other[0], "likely", words)
    roll = max(same, key=lambda n: name_weight("p", n), default="")
    turned = motion.ay and not name_weight("ay", motion.ay)
    tilted = "along" in grid.made.get(motion.r, {})
    if roll and name_weight("p", roll) >= NAMED and motion.r != motion.heading and not (turned or tilted):
        entry = column_entry(roll, motion.units["r"], "rad/s", {})
        yield FoundColumn("p", entry, "likely", "its name; unit as the yaw rate's")
    for role, what in (("ax", "longitudinal acceleration"), ("vy", "lateral speed")):
        named = max(columns, key=lambda n: name_weight(role, n), default="")
        if named and name_weight(role, named) >= NAMED and named != motion.ay and not tilted:
            use = "not used" if role == "ax" else "write vy = ... if it was measured at the centre of gravity"
            yield FoundColumn(role, None, "", f"{what}: {named} ({use})")


def _mark_lines(table: RecordedTable, grid: ColumnGrid) -> Iterator[FoundColumn]:
    """Columns that divide a file into trials, or mark rows that are bad."""
    if len(table.streams) > 1:
        return
    stream = table.streams[0]
    for role, key, words in (
        ("trial", "trial", "its values divide the file"),
        ("bad", "leave_out", "its name"),
    ):
        for name in (n for n in stream.names if name_weight(role, n) >= NAMED):
            values = [str(x) for x in stream[name]]
            changes = sum(a != b for a, b in pairwise(values)) + 1
            if 1 < len(set(values)) == changes <= 100 if key == "trial" else len(set(values)) == 2:
                yield FoundColumn(key, name, "likely", words)
                break
