"""The column map of a recording of another system: which column holds which channel, in what unit.

The map is a small TOML file (or a dictionary of the same form):

    time = "t"                                     # s
    pwm = "steer"                                  # us; or delta, the road-wheel angle, rad
    r = {column = "yaw_rate", unit = "deg/s"}      # also p, ay, vy, speed, phi, psi, throttle
    delta = {column = "steer", scale = 0.35}       # offset is subtracted first, then scale multiplies
    speed = 2.4                                    # a number for a constant value, m/s
    trial = "trial"                                # each value is one recording
    runs = "whole"                                 # all driving of a trial is one run; default "found"
    leave_out = "bad"                              # rows where this column is true (or 1) are left out
    axes = "iso"                                   # or "frd": r, ay, vy, psi, delta change sign
    sampling = "smooth"                            # or "step": steering keeps its value until the next row
    filters = {gyro_hz = 20, accel_hz = 20}        # known low-pass filters, if any

Where there is no gyro or no speed, several columns make one:

    r = {heading = "yaw", unit = "deg"}            # its slope; scale = -1 for a compass, which counts right
    r = {quaternion = ["qx", "qy", "qz", "qw"]}    # the slope of its heading; also for psi
    speed = {position = ["x", "y"]}                # its slope, forward; m
    speed = {lat_lon = ["lat", "lon"]}             # the same in degrees; scale = 1e-7 for whole numbers
    speed = {velocity = ["ve", "vn"]}              # its length
    r = {lat_lon = ["lat", "lon"]}                 # how fast the course turns; also position, velocity
    r = {columns = ["gx", "gy", "gz"], along = [0, 0.6, 0.8]}  # their sum with these weights; also ay, p

A second speed is only compared with the first, and says which of speed and a_y is wrong:

    path_speed = {position = ["x", "y"]}           # also lat_lon, velocity, or a column

A steering in -1 to 1 is no angle: `delta = {column = "steer", unit = "full"}`.

Was the steering commanded, so that the servo is behind it, or measured? Without the key, `pwm` was commanded,
`servo` measured, and of `delta` it is unknown:

    delta = {column = "steer", origin = "commanded"}   # or "measured": by an encoder, or a servo's telemetry

Clocks: date-times are read as they are. `time` is left out where the file has stamps of its own (bags, ULog),
and a list where several files are joined, with one clock of each:

    time = {column = "sec", nanoseconds = "nsec"}
    time = {rate = 100}                            # Hz, even samples without a clock
    time = ["imu.stamp", "steering.stamp"]
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.data.recording import Array, Mask, Origin
from rover_sweep.errors import UsageError
from rover_sweep.files.documents import read_toml

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
    "path_speed": "m/s",
}
WITNESSES = {"path_speed"}  # channels that are only compared with others
OPTIONS = {"time", "trial", "runs", "leave_out", "axes", "sampling", "filters"}
# Unit of a channel -> the units that it may be given in, and their factors
FACTORS: Mapping[str, Mapping[str, float]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "us": {"us": 1.0},
    "rad": {"rad": 1.0, "deg": math.pi / 180, "full": 1.0},  # full: of a steering that is no angle
    "rad/s": {"rad/s": 1.0, "deg/s": math.pi / 180, "mrad/s": 1e-3},
    "m/s": {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "ft/s": 0.3048},
    "m/s^2": {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "ft/s^2": 0.3048},
    "m": {"m": 1.0, "ft": 0.3048},
}
ORIGINS: Mapping[str, Origin] = {"pwm": "commanded", "delta": "unknown", "servo": "measured"}  # if not given
PATHS = {"position": (2, "m"), "lat_lon": (2, ""), "velocity": (2, "m/s")}
# {channel: {how it is made: (number of columns, unit that these have)}}
MADE: Mapping[str, Mapping[str, tuple[int, str]]] = {
    "r": {"heading": (1, "rad"), "quaternion": (4, ""), **PATHS, "columns": (3, "rad/s")},
    "p": {"columns": (3, "rad/s")},
    "ay": {"columns": (3, "m/s^2")},
    "psi": {"quaternion": (4, "")},
    "speed": PATHS,
    "path_speed": PATHS,
}


@dataclass(frozen=True)
class Column:
    """The columns of a channel: (value - offset) * scale is in the channel's unit.

    made: "" for one column as it is, else how several make the channel (MADE). along: weights of `columns`.
    unit: as given, "" for the channel's own. origin: of a steering.
    """

    names: tuple[str, ...]
    scale: float = 1.0
    offset: float = 0.0
    made: str = ""
    along: tuple[float, ...] = ()
    unit: str = ""
    origin: Origin = "unknown"

    @property
    def source(self) -> str:
        """Its words in notes: the column, or what it is made of."""
        return f"{self.made} {', '.join(self.names)}" if self.made else self.names[0]


@dataclass(frozen=True)
class StreamClock:
    """The time of a stream: column, whose seconds are (value - offset) * scale; or its rate [Hz]."""

    column: Column | None = None
    nanoseconds: str | None = None
    rate: float = 0.0

    @property
    def used(self) -> set[str]:
        """Names of the columns that are read."""
        names = set(self.column.names) if self.column else set()
        return names | ({self.nanoseconds} if self.nanoseconds else set())


@dataclass(frozen=True)
class ColumnMap:
    """A checked column map. constants: {channel: value}; frd: FRD axes; step: steering is held."""

    clocks: tuple[StreamClock, ...]
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
        return marks.union(*(c.names for c in self.columns.values()), *(c.used for c in self.clocks))


def own_names(header: Sequence[str]) -> Mapping[str, Any] | None:
    """The map of columns that are named like the channels; None where time or others are not."""
    own = {n: n for n in (*UNITS, "trial") if n in header} | {"time": "t" if "t" in header else "time"}
    needed = own["time"] in header and "r" in own and "speed" in own and {"pwm", "delta"} & set(own)
    return own if needed else None


def rate_alone(given: Mapping[str, Any] | None) -> float:
    """The rate [Hz] of a map that gives nothing else, so that the columns are to be found; else 0."""
    if given is None or set(given) != {"time"} or not isinstance(given["time"], Mapping):
        return 0.0
    return _clock(given["time"], ()).rate if set(given["time"]) == {"rate"} else 0.0


def read_column_map(path: str) -> Mapping[str, Any]:
    """The map in a TOML file; UsageError where it is none."""
    try:
        return read_toml(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path}: the column map cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise UsageError(
            f"{path}: the column map is not a text file ({error.reason} at byte {error.start})"
        ) from error
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{path}: the column map is not valid TOML ({error})") from error


def parse_column_map(given: Mapping[str, Any], header: Sequence[str], stamped: bool = False) -> ColumnMap:
    """Checks a column map against the names of the columns; UsageError for mistakes.

    stamped: whether every stream of the table has its time.
    """
    unknown = set(given) - set(UNITS) - OPTIONS
    if unknown:
        raise UsageError(
            f"Column map: {', '.join(sorted(unknown))} is not known; "
            f"the keys are {', '.join((*UNITS, *sorted(OPTIONS)))}"
        )
    needed = ("r", "speed") if stamped else ("time", "r", "speed")
    missing = [name for name in needed if name not in given]
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
    times = given.get("time", [])
    return ColumnMap(
        clocks=tuple(_clock(t, header) for t in (times if isinstance(times, list) else [times])),
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


def _clock(given: Any, header: Sequence[str]) -> StreamClock:
    entry = dict(given) if isinstance(given, Mapping) else given
    if isinstance(entry, dict) and set(entry) == {"rate"}:
        rate = _number("rate of time", entry["rate"])
        if rate <= 0:
            raise UsageError(f"Column map: rate of time = {rate:g} Hz, it must be above 0")
        return StreamClock(rate=rate)
    fine = entry.pop("nanoseconds", None) if isinstance(entry, dict) else None
    if fine is not None and fine not in header:
        raise UsageError(f"Column map: nanoseconds = {fine!r}, but the columns are {', '.join(header)}")
    return StreamClock(_column("time", entry, header), fine)


def _column(channel: str, given: Any, header: Sequence[str]) -> Column:
    entry = {"column": given} if isinstance(given, str) else given
    ways = {"column": (1, UNITS.get(channel, "s")), **MADE.get(channel, {})}
    way = next((key for key in ways if isinstance(entry, Mapping) and key in entry), "column")
    weighted = {"along"} if way == "columns" else set()
    keys = {way, "scale", "offset", "unit", *weighted, *({"origin"} if channel in ("pwm", "delta") else ())}
    if not isinstance(entry, Mapping) or not weighted <= set(entry) <= keys:
        raise UsageError(
            f'Column map: {channel} = {given!r}, it must be "name" or {{column, unit, scale, offset}}'
            f"{', with origin for a steering' if channel in ('pwm', 'delta') else ''}"
        )
    count, unit = ways[way]
    named = entry.get(way)
    names: tuple[Any, ...] = tuple(named) if isinstance(named, list | tuple) and count > 1 else (named,)
    for name in names:
        if name not in header:
            raise UsageError(f"Column map: {channel} = {name!r}, but the columns are {', '.join(header)}")
    if len(names) != count:
        raise UsageError(f"Column map: {channel} = {given!r}; {way} needs a list of {count} columns")
    scale = _number(f"scale of {channel}", entry.get("scale", 1.0)) * _factor(
        channel, unit, entry.get("unit")
    )
    if scale == 0 or (channel == "time" and scale < 0):
        wanted = "above 0" if channel == "time" else "another number"
        raise UsageError(f"Column map: scale of {channel} = {entry['scale']!r}, it must be {wanted}")
    offset = _number(f"offset of {channel}", entry.get("offset", 0.0))
    along = tuple(_number(f"along of {channel}", x) for x in entry.get("along", ()))
    if weighted and len(along) != count:
        raise UsageError(f"Column map: {channel} = {given!r}; along needs {count} numbers")
    origin = _origin(channel, entry.get("origin", ORIGINS.get(channel, "unknown")))
    made = "" if way == "column" else way
    return Column(names, scale, offset, made, along, entry.get("unit", ""), origin)


def _origin(channel: str, given: Any) -> Origin:
    for origin in ORIGINS.values():
        if given == origin:
            return origin
    raise UsageError(
        f'Column map: origin of {channel} = {given!r}, it must be "commanded", "measured" or "unknown"'
    )


def _factor(channel: str, own: str, unit: Any) -> float:
    if unit is None:
        return 1.0
    if not isinstance(unit, str) or unit not in FACTORS.get(own, ()):
        units = f"use {', '.join(FACTORS[own])}, or scale to {own}" if own else "leave it out"
        raise UsageError(f"Column map: the unit {unit!r} of {channel} is not known; {units}")
    return FACTORS[own][unit]


# Signals that are made of several recorded ones: heading of a quaternion, slopes of positions and angles.


NEIGHBOURS, AROUND = 2, 0.03  # samples, and s, on each side in the regression that gives a slope
HELD = 0.15  # s; a value that repeats for less is one sample that was written several times
LONGER = 1.5  # times the usual time between two values, up to which one that repeats is also one sample


def heading_of(x: Array, y: Array, z: Array, w: Array) -> Array:
    """The heading (n,) rad, left positive with z up, of quaternions with w last."""
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))


DEGREE = 111_319.5  # m, of a great circle


def local_metres(lat: Array, lon: Array) -> tuple[Array, Array]:
    """East and north (n,) m of the first position, of degrees; nan where both are 0, as without a fix."""
    none = (lat == 0) & (lon == 0)
    lat, lon = np.where(none, np.nan, lat), np.where(none, np.nan, lon)
    known = np.flatnonzero(np.isfinite(lat + lon))[:1]
    if not known.size:
        return lat, lon
    north, east = lat - lat[known[0]], (lon - lon[known[0]] + 180) % 360 - 180
    return east * DEGREE * np.cos(np.radians(lat)), north * DEGREE


def course_rate(vx: Array, vy: Array, ax: Array, ay: Array) -> Array:
    """How fast (n,) rad/s the course of this velocity and its slope turns; 0 at standstill."""
    speed = np.hypot(vx, vy)
    fast = np.maximum(speed, 0.2 * float(np.percentile(speed, 95)) + 1e-12)
    return np.asarray((vx * ay - vy * ax) / fast**2)


def measured_once(t: Array, x: Array) -> Mask:
    """True (n,) where a value was measured, False where a slower source's last value is written again."""
    new = np.concatenate(([True], np.diff(x) != 0))
    usual = float(np.median(np.diff(t[new]))) if new.sum() > 1 else 0.0
    last = np.maximum.accumulate(np.where(new, t, -np.inf))
    return np.asarray(new | (t - last >= max(HELD, LONGER * usual)))


def slope(t: Array, x: Array) -> Array:
    """dx/dt (n,) at times t (n,) s, by regression over the nearest samples; without delay.

    Values that a slower source wrote several times count once, at their first time.
    """
    if t.size < 2:
        return np.zeros_like(x)
    new = measured_once(t, x)
    s, y = t[new], x[new]
    if s.size < 2:
        return np.zeros_like(x)
    reach = max(NEIGHBOURS, round(AROUND / float(np.median(np.diff(s)))))
    reach = min(reach, (s.size - 1) // 2)
    if reach == 0:
        return np.full(t.size, (y[-1] - y[0]) / (s[-1] - s[0]))
    windows = [np.lib.stride_tricks.sliding_window_view(each, 2 * reach + 1) for each in (s, y)]
    centred = [w - w.mean(axis=1, keepdims=True) for w in windows]
    middle = np.sum(centred[0] * centred[1], axis=1) / np.sum(centred[0] ** 2, axis=1)
    return np.interp(t, s[reach : s.size - reach], middle)
