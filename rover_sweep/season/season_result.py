"""A season as frozen values; `rover_sweep.report.season` writes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

DriftKind = Literal["gradual", "step", "day", "board", "parameter"]
"""gradual: grows from a day on. step: another value from a day on. day: on one day only, which is no drift.
board: another autopilot. parameter: one of the firmware that changes the recorded signals or the steering."""


@dataclass(frozen=True)
class ParameterChange:
    """A parameter of the firmware that differs between two days of a vehicle. before, after: its values."""

    name: str
    day_before: str
    day_after: str
    before: float
    after: float


@dataclass(frozen=True)
class Drift:
    """Something that changed on a vehicle.

    quantity: its name. day: first day after a step, or last day before a gradual change begins; earliest,
    latest: its 95 % interval (days of logs). before, after: the quantity (at the end of the season where
    gradual), None for a board. low, high: 90 % interval of after minus before, or of after/before where
    `relative`. ratio: change over its standard deviation. matters: False where within tolerance.
    cause: event at the same time that explains it, "" for none. parameters: changes at that time.
    """

    vehicle: str
    kind: DriftKind
    quantity: str
    meaning: str
    unit: str
    day: str
    earliest: str
    latest: str
    before: float | None = None
    after: float | None = None
    low: float | None = None
    high: float | None = None
    relative: bool = False
    ratio: float | None = None
    matters: bool = True
    look_alikes: tuple[str, ...] = ()
    cause: str = ""
    parameters: tuple[ParameterChange, ...] = ()
    sentence: str = ""

    @property
    def counts(self) -> bool:
        """False for what is within tolerance, on one day only, or caused by another change."""
        return self.matters and not self.cause and self.kind != "day"


@dataclass(frozen=True)
class DayValue:
    """A quantity on one day, with a 90 % interval of its difference from the vehicle's other days.

    The interval includes the usual scatter from day to day and leaves out what is wrong on every day alike.
    fitted: value at that day of the course that the season shows.
    """

    day: str
    value: float
    low: float
    high: float
    fitted: float


@dataclass(frozen=True)
class TrackedQuantity:
    """A quantity of a vehicle over its days. scatter: usual standard deviation from day to day."""

    name: str
    unit: str
    meaning: str
    scatter: float
    days: tuple[DayValue, ...]


@dataclass(frozen=True)
class VehicleSeason:
    """A vehicle. logs: sources of each day, {day: sources}. boards: {board: first day}."""

    name: str
    logs: Mapping[str, tuple[str, ...]]
    boards: Mapping[str, str]
    quantities: tuple[TrackedQuantity, ...] = ()
    drifts: tuple[Drift, ...] = ()
    parameters: tuple[ParameterChange, ...] = ()
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Season:
    """A fleet's season. refused: (source, why) of every log without a fit. tests: their number."""

    sentence: str
    vehicles: tuple[VehicleSeason, ...]
    refused: tuple[tuple[str, str], ...]
    logs: int
    tests: int

    @property
    def drifts(self) -> tuple[Drift, ...]:
        """Those of all vehicles that matter and that no other event explains."""
        return tuple(d for v in self.vehicles for d in v.drifts if d.counts)
