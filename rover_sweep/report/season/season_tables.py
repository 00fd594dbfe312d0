"""A season as tables of its pages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rover_sweep.report.identification.comparison import Cell, Table
from rover_sweep.report.wording.number_format import number, symbol, unit
from rover_sweep.season.season_result import Drift, ParameterChange, Season, VehicleSeason

KINDS = {
    "gradual": "gradual",
    "step": "from a day on",
    "day": "one day only",
    "board": "board swapped",
    "parameter": "parameter",
}
INTERVAL = (
    "90 % interval of the change. Days: a gradual change begins after the day, others are seen on it first; "
    "in brackets the 95 % interval."
)


def drift_table(drifts: Sequence[Drift], heading: str) -> Table:
    """Vehicle, quantity, kind, day, values and interval of each drift."""
    rows = tuple(
        (
            Cell(d.vehicle),
            Cell(d.quantity if d.kind in ("board", "parameter") else symbol(d.quantity), "strong"),
            Cell(KINDS[d.kind]),
            Cell(_day(d)),
            Cell(d.cause or "–"),
            Cell(number(d.before, 3)),
            Cell(number(d.after, 3), "strong"),
            Cell(_interval(d)),
            Cell(unit(d.unit)),
        )
        for d in drifts
    )
    headings = ("vehicle", "quantity", "", "day", "cause", "before", "after", "change (90 %)", "unit")
    return Table(heading, headings, rows, INTERVAL, 5)


def _day(d: Drift) -> str:
    return d.day if d.earliest == d.latest else f"{d.day} ({d.earliest} to {d.latest})"


def _interval(d: Drift) -> str:
    if d.low is None or d.high is None:
        return "–"
    if d.relative:
        return f"{100 * (d.low - 1):+.0f} to {100 * (d.high - 1):+.0f} %"
    return f"{d.low:+.3g} to {d.high:+.3g}"


def refused_table(season: Season) -> Table:
    """Every log without a fit, with its sentence."""
    rows = tuple((Cell(source), Cell(why)) for source, why in season.refused)
    return Table("Logs that could not be used", ("log", "why"), rows, text_columns=2)


def parameter_change_table(changes: Sequence[ParameterChange]) -> Table:
    """Parameters of the firmware that changed, by day."""
    rows = tuple(
        (
            Cell(c.name, "strong"),
            Cell(f"{c.day_before} to {c.day_after}"),
            Cell(f"{c.before:g}"),
            Cell(f"{c.after:g}"),
        )
        for c in changes
    )
    return Table("Parameters that changed", ("parameter", "between", "before", "after"), rows, text_columns=2)


def season_value_table(vehicle: VehicleSeason) -> Table:
    """First and last value of each quantity, with its scatter from day to day."""
    rows = tuple(
        (
            Cell(q.meaning),
            Cell(symbol(q.name), "strong"),
            Cell(number(q.days[0].value, 3)),
            Cell(number(q.days[-1].value, 3)),
            Cell(f"{number(q.days[-1].low, 3)} to {number(q.days[-1].high, 3)}"),
            Cell(number(q.scatter, 2)),
            Cell(unit(q.unit)),
        )
        for q in vehicle.quantities
        if q.days
    )
    headings = ("quantity", "", "first day", "last day", "90 %", "scatter", "unit")
    note = (
        "Intervals are of differences between days. scatter: standard deviation from day to day that no "
        "interval of a single day explains."
    )
    return Table("Values", headings, rows, note, 2)


def diagnosis_table(sentences: Mapping[str, str]) -> Table:
    """The sentence of each day's diagnosis."""
    rows = tuple((Cell(day), Cell(text)) for day, text in sentences.items())
    note = "The reports are in diagnoses/, by vehicle and day."
    return Table("Diagnosis of each day", ("day", "left out by the model"), rows, note, 2)


def day_table(vehicle: VehicleSeason) -> Table:
    """The logs of each day."""
    rows = tuple((Cell(day), Cell(", ".join(sources))) for day, sources in vehicle.logs.items())
    return Table("Days", ("day", "logs"), rows, text_columns=2)
