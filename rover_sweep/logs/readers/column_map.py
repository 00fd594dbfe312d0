"""The column map of a .csv: which column holds which channel, in what unit.

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
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rover_sweep.data.geometry import STANDARD_GRAVITY
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


def read_column_map(given: Mapping[str, Any] | str | None, header: list[str], file_name: str) -> ColumnMap:
    """The map of a file with these columns: given, from a TOML file, or by columns named like channels."""
    return parse_column_map(_loaded(given, header, file_name), header)


def _loaded(given: Mapping[str, Any] | str | None, header: list[str], file_name: str) -> Mapping[str, Any]:
    if given is None:
        own = {n: n for n in (*UNITS, "trial") if n in header} | {"time": "t" if "t" in header else "time"}
        if own["time"] in header and len(own) > 2:
            return own
        raise UsageError(
            f"{file_name} needs a column map: give --columns FILE, a TOML file with time, pwm or delta, r, "
            f"speed, ... (docs/formats.md has one); its columns are {', '.join(header)}"
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
    filters = {name: _number(name, value) for name, value in given.items()}
    for name, value in filters.items():
        if value < 0:
            raise UsageError(
                f"Column map: {name} = {value:g} Hz; a cut-off must be positive, or 0 for no filter"
            )
    return filters


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
