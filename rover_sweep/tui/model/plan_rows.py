"""The plan as rows that can be added, changed and removed; pure functions. Space comes from `design`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.design.demand import Space, space
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.applet_values import parameters_of
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Manoeuvre, Sweep, ThrottleSweep

SPEED = 2.0  # m/s, default of a row
FIRST_THROTTLE = 30.0  # us, of a first throttle sweep: the full one may pass the limits of the speed
_KINDS: dict[str, Callable[[], Manoeuvre]] = {
    "sweep": Sweep,
    "doublet": Doublet,
    "multisine": Multisine,
    "bias_sweep": BiasSweep,
    "throttle": lambda: ThrottleSweep(amplitude=FIRST_THROTTLE),
}


@dataclass(frozen=True)
class Row:
    """A run to drive. speed [m/s]: to hold; name: kept through all changes; settles: its purpose as a
    sentence, if known."""

    manoeuvre: Manoeuvre
    speed: float = SPEED
    name: str = ""
    settles: str = ""

    @property
    def kind(self) -> str:
        """The kind, as used in names of runs."""
        return self.manoeuvre.kind.replace("_", "-")


@dataclass(frozen=True)
class Field:
    """A number of a row that can be changed in steps. form: its format."""

    name: str
    words: str
    unit: str
    step: float
    form: str = "g"


_SPEED = Field("speed", "speed to hold", "m/s", 0.2, ".1f")
_AMPLITUDE = Field("amplitude", "amplitude", "us", 10)
_SWEPT = (
    Field("w_min", "lowest frequency", "rad/s", 0.1, ".1f"),
    Field("w_max", "highest frequency", "rad/s", 1),
    Field("t_rec", "sweep duration", "s", 5),
)
_FIELDS: Mapping[str, tuple[Field, ...]] = {
    "sweep": (_AMPLITUDE, _SPEED, *_SWEPT),
    "bias_sweep": (_AMPLITUDE, Field("bias", "offset", "us", 10), _SPEED, *_SWEPT),
    "throttle": (_AMPLITUDE, _SPEED, *_SWEPT),
    "multisine": (_AMPLITUDE, _SPEED, *_SWEPT, Field("periods", "periods", "", 1)),
    "doublet": (
        _AMPLITUDE,
        _SPEED,
        Field("pulse", "step duration", "s", 0.1, ".1f"),
        Field("pause", "pause", "s", 0.5, ".1f"),
        Field("count", "number of doublets", "", 1),
    ),
}

FIRST = (
    Row(Sweep(), name="sweep1"),
    Row(Sweep(), name="sweep2"),
    Row(Doublet(), name="doublet1"),
)  # the default of `rover-sweep run`


def fields(row: Row) -> tuple[Field, ...]:
    """The numbers of a row that can be changed."""
    return _FIELDS[row.manoeuvre.kind]


def value(row: Row, of: Field) -> float:
    """The current value of a field."""
    return float(row.speed if of.name == "speed" else getattr(row.manoeuvre, of.name))


def new(kind: str, speed: float = SPEED) -> Row:
    """A row with default numbers."""
    return Row(_KINDS[kind](), speed)


def row_with(row: Row, of: Field, number: float, limits: Mapping[str, float] | None = None) -> Row:
    """The row with a new number. UsageError if the applet would refuse it; limits: of the applet."""
    number = round(number, 3)
    if of.name == "speed":
        if not 0 < number <= 30:
            raise UsageError(f"a speed of {number:g} m/s is not possible; use 0.2 to 30")
        return replace(row, speed=number)
    kept: Any = int(number) if of.name in ("periods", "count") else number
    try:
        manoeuvre = replace(row.manoeuvre, **{of.name: kept})
    except ValueError as error:
        raise UsageError(str(error)) from error
    parameters_of(manoeuvre, **(limits or {}))
    return replace(row, manoeuvre=manoeuvre, settles="")


def with_names(rows: Iterable[Row], taken: Iterable[str]) -> tuple[Row, ...]:
    """The rows, with the first free name of sweep1, sweep2, ... for those without a name."""
    rows = tuple(rows)
    names = {*taken, *(row.name for row in rows)}
    found = []
    for row in rows:
        number = 1
        while not row.name and f"{row.kind}{number}" in names:
            number += 1
        found.append(row if row.name else replace(row, name=f"{row.kind}{number}"))
        names.add(found[-1].name)
    return tuple(found)


@dataclass(frozen=True)
class Needs:
    """Space and time needed. spaces: of each row, None without steering in the vehicle file; words: why."""

    spaces: tuple[Space | None, ...] = ()
    seconds: float = 0.0
    words: str = field(default="")


def needs(rows: tuple[Row, ...], vehicle: Vehicle | None) -> Needs:
    """Space of each run [m] and the duration of all [s]."""
    seconds = sum(row.manoeuvre.duration for row in rows)
    if vehicle is None:
        return Needs((None,) * len(rows), seconds, "no vehicle file: the space needed is unknown")
    try:
        return Needs(tuple(space(row.manoeuvre, vehicle, row.speed) for row in rows), seconds)
    except UsageError as error:
        return Needs((None,) * len(rows), seconds, str(error).partition(";")[0])


def ground(row: Row, vehicle: Vehicle | None) -> str:
    """The space that a row needs, as part of a sentence; "" if unknown."""
    (known,) = needs((row,), vehicle).spaces
    return f", on {known.length:.0f} x {known.width:.0f} m" if known else ""


def largest(spaces: Iterable[Space | None]) -> tuple[float, float]:
    """(length, width) [m] of the space that is enough for each of them; NaN if all are unknown."""
    known = [s for s in spaces if s is not None]
    if not known:
        return math.nan, math.nan
    return max(s.length for s in known), max(s.width for s in known)


def rows_of_plan(document: Mapping[str, Any]) -> tuple[Row, ...]:
    """Rows from the JSON of `rover-sweep plan` (report/diagnosis/plan_table.py); one row per repeat.

    Servo tests on blocks are skipped, as nothing is driven.
    """
    rows: list[Row] = []
    settles = [str(s) for s in document.get("settles") or ()]
    for n, run in enumerate(document.get("proposal") or ()):
        if run["kind"] not in _KINDS:
            continue
        numbers: dict[str, Any] = {"amplitude": float(run["amplitude_us"])}
        if run["kind"] == "bias_sweep":
            numbers["bias"] = float(run["bias_us"])
        row = Row(
            replace(_KINDS[run["kind"]](), **numbers),
            float(run["speed"]),
            "",
            settles[n] if n < len(settles) else "",
        )
        rows += [row] * int(run.get("repeat", 1))
    return tuple(rows)
