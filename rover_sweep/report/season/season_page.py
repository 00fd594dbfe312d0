"""The pages of a season, each one self-contained HTML file."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

from rover_sweep.data.results import number
from rover_sweep.errors import missing_extra
from rover_sweep.files.replaced import write_file
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.response_charts import season_chart
from rover_sweep.report.charts.static_svg import ShownChart, by_section, shown_chart
from rover_sweep.report.identification.comparison import Cell, Table
from rover_sweep.report.templates import environment
from rover_sweep.report.wording import sentence, strict_json, symbol, unit, versions
from rover_sweep.season.season_result import Drift, MeasuredLog, ParameterChange, Season, VehicleSeason

# A season as tables of columns for other programs: CSV, and Parquet with pyarrow.


Columns = Mapping[str, Sequence[Any]]


def season_columns(season: Season, logs: Sequence[MeasuredLog]) -> dict[str, Columns]:
    """{table: {column: values}} of quantities, drifts, parameters and logs; None where there is no value."""
    values = [
        (v.name, d.day, q.name, q.unit, d.value, d.low, d.high, d.fitted) for v, q, d in _values(season)
    ]
    drifts = [
        (
            d.vehicle,
            d.kind,
            d.quantity,
            d.unit,
            d.day,
            d.earliest,
            d.latest,
            d.before,
            d.after,
            d.low,
            d.high,
            d.relative,
            d.ratio,
            d.matters,
            d.cause,
            d.sentence,
        )
        for v in season.vehicles
        for d in v.drifts
    ]
    changed = [
        (v.name, p.name, p.day_before, p.day_after, p.before, p.after)
        for v in season.vehicles
        for p in v.parameters
    ]
    vehicle_of = {s: v.name for v in season.vehicles for day in v.logs.values() for s in day}
    each = [
        (
            log.source,
            vehicle_of.get(log.source, ""),
            log.day,
            log.day_from,
            log.board,
            log.system,
            log.firmware,
            log.sha256,
            log.fit.variance if log.fit else None,
            log.refused,
        )
        for log in sorted(logs, key=lambda log: log.source)
    ]
    return {
        "quantities": _table("vehicle day quantity unit value low high fitted", values),
        "drifts": _table(
            "vehicle kind quantity unit day earliest latest before after low high relative ratio matters "
            "cause sentence",
            drifts,
        ),
        "parameters": _table("vehicle parameter day_before day_after before after", changed),
        "logs": _table(
            "log vehicle day day_from board system firmware sha256 residual_over_noise refused", each
        ),
    }


def _values(season: Season) -> Any:
    return ((v, q, d) for v in season.vehicles for q in v.quantities for d in q.days)


def _table(names: str, rows: Sequence[Sequence[Any]]) -> Columns:
    return {name: [row[k] for row in rows] for k, name in enumerate(names.split())}


def as_csv(columns: Columns) -> str:
    """The columns with a heading; numbers exact, nothing for None."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow(["" if x is None else repr(x) if isinstance(x, float) else x for x in row])
    return out.getvalue()


def as_parquet(columns: Columns) -> bytes:
    """The columns as a Parquet file; UsageError without pyarrow."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise missing_extra("--parquet needs pyarrow", "fleet") from None
    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), sink)
    return bytes(sink.getvalue())


# The quantities of a vehicle against the date.


CAPTION = (
    "Each day with its 90 % interval (of differences between days). Line: the course that the season shows; "
    "orange: a change. Quantities with a change first."
)


def shown_courses(vehicle: VehicleSeason) -> tuple[ShownChart, ...]:
    """One picture with a chart of each quantity."""
    if not vehicle.quantities:
        return ()
    draw = partial(season_chart, vehicle.quantities, vehicle.drifts)
    return (shown_chart(ChartPlan("courses", "courses", CAPTION, draw)),)


# A season as tables of its pages.


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


# The summary of a season on a terminal.


def season_summary(season: Season, console: Console) -> None:
    """The answer, each change in a sentence, each log that could not be used."""
    console.print(sentence(season.sentence), style="bold", markup=False, soft_wrap=True)
    for vehicle in season.vehicles:
        for drift in vehicle.drifts:
            if drift.counts or (drift.cause and drift.matters):
                mark = "  " if drift.cause else "- "
                console.print(f"{mark}{drift.sentence}", markup=False, soft_wrap=True)
    for source, why in season.refused:
        console.print(f"not used: {source}: {why}", style="yellow", markup=False, soft_wrap=True)


Section = tuple[str, str, Sequence[Table], str, Sequence[str]]  # anchor, heading, tables, pictures, texts


def page_names(season: Season) -> dict[str, str]:
    """{vehicle: name of its page without .html}; every name is different."""
    out: dict[str, str] = {}
    for vehicle in season.vehicles:
        slug = re.sub(r"[^A-Za-z0-9_-]+", "-", vehicle.name).strip("-") or "vehicle"
        count = sum(other == slug or other.startswith(f"{slug}.") for other in out.values())
        out[vehicle.name] = f"{slug}.{count + 1}" if count else slug
    return out


def fleet_page(season: Season) -> str:
    """The page of the fleet, with links to the vehicles in vehicles/."""
    sections: list[Section] = []
    if season.drifts:
        sections.append(("drifts", "What changed", (drift_table(season.drifts, "What changed"),), "", ()))
    follow = [d for v in season.vehicles for d in v.drifts if d.matters and d.cause]
    if follow:
        sections.append(
            ("with", "What changed with them", (drift_table(follow, "At the same time"),), "", ())
        )
    minor = [d for v in season.vehicles for d in v.drifts if not d.counts and not d.cause]
    if minor:
        heading = "Within normal tolerance, or on one day only"
        sections.append(("minor", heading, (drift_table(minor, heading),), "", ()))
    if season.refused:
        sections.append(("refused", "Logs that could not be used", (refused_table(season),), "", ()))
    names = page_names(season)
    vehicles = [
        (v.name, f"vehicles/{names[v.name]}.html", len(v.logs), sum(map(len, v.logs.values())), _summary(v))
        for v in season.vehicles
    ]
    tone = "warn" if season.drifts else "good"
    verdict = "changed" if season.drifts else "unchanged"
    return _page(
        "Season of the fleet", (season.sentence, verdict, tone), season.drifts, sections, vehicles, ()
    )


def vehicle_page(vehicle: VehicleSeason, pictures: Sequence[ShownChart], diagnoses: Mapping[str, str]) -> str:
    """The page of a vehicle. diagnoses: {day: sentence}."""
    found = [d for d in vehicle.drifts if d.counts]
    sections: list[Section] = []
    if vehicle.drifts:
        sections.append(("drifts", "What changed", (drift_table(vehicle.drifts, "What changed"),), "", ()))
    if vehicle.quantities:
        sections.append(("courses", "Day by day", (), "courses", ()))
        sections.append(("values", "Values", (season_value_table(vehicle),), "", ()))
    if vehicle.parameters:
        table = parameter_change_table(vehicle.parameters)
        sections.append(("parameters", "Parameters that changed", (table,), "", ()))
    if diagnoses:
        sections.append(("diagnoses", "Diagnosis of each day", (diagnosis_table(diagnoses),), "", ()))
    boards = tuple(f"{board}: from {day} on." for board, day in vehicle.boards.items())
    sections.append(
        ("days", "Days and logs", (day_table(vehicle),), "", (*boards, *map(sentence, vehicle.remarks)))
    )
    words = (
        f"{len(found)} change(s) in {len(vehicle.logs)} day(s)"
        if found
        else (f"nothing changed in {len(vehicle.logs)} day(s)")
    )
    answer = words, "changed" if found else "unchanged", "warn" if found else "good"
    return _page(vehicle.name, answer, found, sections, (), pictures)


def _summary(vehicle: VehicleSeason) -> str:
    found = [d.quantity for d in vehicle.drifts if d.counts]
    return ", ".join(found) if found else "–"


def _page(
    title: str,
    answer: tuple[str, str, str],
    drifts: Sequence[Drift],
    sections: Sequence[Section],
    vehicles: Sequence[tuple[str, str, int, int, str]],
    pictures: Sequence[ShownChart],
) -> str:
    return (
        environment("report/season")
        .get_template("season.html.j2")
        .render(
            title=title,
            answer=sentence(answer[0]),
            verdict=answer[1],
            tone=answer[2],
            lines=[sentence(d.sentence) for d in drifts],
            sections=sections,
            vehicles=vehicles,
            versions=versions(),
            pictures=by_section(pictures),
        )
    )


# The folder of a season.


def write_season(
    season: Season,
    logs: Sequence[MeasuredLog],
    pages: Mapping[str, str],
    directory: Path,
    parquet: bool = False,
) -> Path:
    """Write season.html, vehicles/*.html, season.json and the tables; the path of the fleet's page.

    pages: {vehicle: HTML}. The same season gives the same bytes.
    """
    tables = season_columns(season, logs)
    if parquet:
        for name, columns in tables.items():
            write_file(directory / f"{name}.parquet", as_parquet(columns))
    for name, columns in tables.items():
        write_file(directory / f"{name}.csv", as_csv(columns))
    names = page_names(season)
    for vehicle, page in pages.items():
        write_file(directory / "vehicles" / f"{names[vehicle]}.html", page)
    write_file(directory / "season.json", season_document(season))
    return write_file(directory / "season.html", fleet_page(season))


def season_document(season: Season) -> str:
    """season.json: every number of the season."""
    return strict_json({"format": "rover-sweep season", "format_version": 1, **asdict(season)})
