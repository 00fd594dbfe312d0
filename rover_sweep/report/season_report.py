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

from rover_sweep.data.results import ends_words, number
from rover_sweep.errors import missing_extra
from rover_sweep.files.documents import write_file
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.response_charts import season_chart
from rover_sweep.report.document import (
    Badge,
    Cell,
    Document,
    Figures,
    Part,
    Section,
    Sentence,
    Table,
    items,
    some,
    table_of,
)
from rover_sweep.report.in_html import in_html
from rover_sweep.report.wording import count, sentence, strict_json, symbol, unit, versions, versions_words
from rover_sweep.season.season_result import Drift, MeasuredLog, Season, VehicleSeason

# A season as tables of columns for other programs: CSV, and Parquet with pyarrow.


Columns = Mapping[str, Sequence[Any]]
DRIFT = (
    "vehicle kind quantity unit day earliest latest before after low high relative ratio matters cause "
    "sentence"
)
LOG = "day day_from board system firmware sha256"


def season_columns(season: Season, logs: Sequence[MeasuredLog]) -> dict[str, Columns]:
    """{table: {column: values}} of quantities, drifts, parameters and logs; None where there is no value."""
    values = [
        {"vehicle": v.name, "day": d.day, "quantity": q.name, "unit": q.unit}
        | {name: getattr(d, name) for name in ("value", "low", "high", "fitted")}
        for v in season.vehicles
        for q in v.quantities
        for d in q.days
    ]
    drifts = [{name: getattr(d, name) for name in DRIFT.split()} for v in season.vehicles for d in v.drifts]
    changed = [
        {"vehicle": v.name, "parameter": p.name}
        | {name: getattr(p, name) for name in ("day_before", "day_after", "before", "after")}
        for v in season.vehicles
        for p in v.parameters
    ]
    vehicle_of = {s: v.name for v in season.vehicles for day in v.logs.values() for s in day}
    each = [
        {"log": log.source, "vehicle": vehicle_of.get(log.source, "")}
        | {name: getattr(log, name) for name in LOG.split()}
        | {"residual_over_noise": log.fit.variance if log.fit else None, "refused": log.refused}
        for log in sorted(logs, key=lambda log: log.source)
    ]
    tables = {
        "quantities": ("vehicle day quantity unit value low high fitted", values),
        "drifts": (DRIFT, drifts),
        "parameters": ("vehicle parameter day_before day_after before after", changed),
        "logs": (f"log vehicle {LOG} residual_over_noise refused", each),
    }
    return {t: {n: [row[n] for row in rows] for n in names.split()} for t, (names, rows) in tables.items()}


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
    rows = []
    for d in drifts:
        change = "–"
        if d.low is not None and d.high is not None:
            change = f"{d.low:+.3g} to {d.high:+.3g}"
            if d.relative:
                change = f"{100 * (d.low - 1):+.0f} to {100 * (d.high - 1):+.0f} %"
        rows.append(
            (
                d.vehicle,
                Cell(d.quantity if d.kind in ("board", "parameter") else symbol(d.quantity), "strong"),
                KINDS[d.kind],
                d.day if d.earliest == d.latest else f"{d.day} ({d.earliest} to {d.latest})",
                d.cause or "–",
                number(d.before, 3),
                Cell(number(d.after, 3), "strong"),
                change,
                unit(d.unit),
            )
        )
    headings = ("vehicle", "quantity", "", "day", "cause", "before", "after", "change (90 %)", "unit")
    return table_of(heading, headings, rows, INTERVAL, 5)


def season_value_table(vehicle: VehicleSeason) -> Table:
    """First and last value of each quantity, with its scatter from day to day."""
    rows = (
        (
            q.meaning,
            Cell(symbol(q.name), "strong"),
            number(q.days[0].value, 3),
            number(q.days[-1].value, 3),
            ends_words(q.days[-1].low, q.days[-1].high),
            number(q.scatter, 2),
            unit(q.unit),
        )
        for q in vehicle.quantities
        if q.days
    )
    headings = ("quantity", "", "first day", "last day", "90 %", "scatter", "unit")
    note = (
        "Intervals are of differences between days. scatter: standard deviation from day to day that no "
        "interval of a single day explains."
    )
    return table_of("Values", headings, rows, note, 2)


# A season, and one vehicle of it, as documents.


def page_names(season: Season) -> dict[str, str]:
    """{vehicle: name of its page without .html}; every name is different."""
    out: dict[str, str] = {}
    for vehicle in season.vehicles:
        slug = re.sub(r"[^A-Za-z0-9_-]+", "-", vehicle.name).strip("-") or "vehicle"
        count = sum(other == slug or other.startswith(f"{slug}.") for other in out.values())
        out[vehicle.name] = f"{slug}.{count + 1}" if count else slug
    return out


def season_report(season: Season) -> Document:
    """The season of the fleet, with links to the pages of the vehicles in vehicles/."""
    drifts = [d for v in season.vehicles for d in v.drifts]
    follow = [d for d in drifts if d.matters and d.cause]
    minor = [d for d in drifts if not d.counts and not d.cause]
    refused = (f"not used: {source}: {why}" for source, why in season.refused)
    small, unused = "Within normal tolerance, or on one day only", "Logs that could not be used"
    names = page_names(season)
    vehicles = (
        (
            Cell(v.name, link=f"vehicles/{names[v.name]}.html"),
            ", ".join(d.quantity for d in v.drifts if d.counts) or "–",
            str(len(v.logs)),
            str(sum(map(len, v.logs.values()))),
        )
        for v in season.vehicles
    )
    fleet = table_of("Vehicles", ("vehicle", "changed", "days", "logs"), vehicles, text_columns=2)
    sections = (
        ("Vehicles", fleet, "vehicles"),
        ("What changed", drift_table(season.drifts, "What changed"), "drifts"),
        ("What changed with them", drift_table(follow, "At the same time"), "with"),
        (small, drift_table(minor, small), "minor"),
        (unused, table_of(unused, ("log", "why"), season.refused, text_columns=2), "refused"),
    )
    return Document(
        "Season of the fleet",
        f"rover-sweep {versions()['rover_sweep']}",
        (
            _verdict(season.sentence, bool(season.drifts)),
            *items([sentence(d.sentence) for d in drifts if d.counts or d in follow]),
            *(Sentence(words, "warn", level="terminal") for words in refused),
        ),
        tuple(Section(heading, some(table), place, level="page") for heading, table, place in sections),
        foot=(Sentence(versions_words(versions()), "muted"),),
    )


def vehicle_report(vehicle: VehicleSeason, diagnoses: Mapping[str, str]) -> Document:
    """One vehicle of a season. diagnoses: {day: sentence}."""
    found = [d for d in vehicle.drifts if d.counts]
    days = count(len(vehicle.logs), "day")
    words = f"{count(len(found), 'change')} in {days}" if found else f"nothing changed in {days}"
    boards = tuple(f"{board}: from {day} on." for board, day in vehicle.boards.items())
    draw = partial(season_chart, vehicle.quantities, vehicle.drifts)
    courses = Figures((ChartPlan("courses", CAPTION, draw),) if vehicle.quantities else ())
    remarks = (Sentence(text) for text in (*boards, *map(sentence, vehicle.remarks)))
    parameters = table_of(
        "Parameters that changed",
        ("parameter", "between", "before", "after"),
        (
            (Cell(c.name, "strong"), f"{c.day_before} to {c.day_after}", f"{c.before:g}", f"{c.after:g}")
            for c in vehicle.parameters
        ),
        text_columns=2,
    )
    diagnosed = table_of(
        "Diagnosis of each day",
        ("day", "left out by the model"),
        diagnoses.items(),
        "The reports are in diagnoses/, by vehicle and day.",
        2,
    )
    logs = ((day, ", ".join(sources)) for day, sources in vehicle.logs.items())
    sections: tuple[tuple[str, tuple[Part, ...], str], ...] = (
        ("What changed", some(drift_table(vehicle.drifts, "What changed")), "drifts"),
        ("Day by day", some(courses), "courses"),
        ("Values", some(season_value_table(vehicle)), "values"),
        ("Parameters that changed", some(parameters), "parameters"),
        ("Diagnosis of each day", some(diagnosed), "diagnoses"),
        ("Days and logs", (*remarks, table_of("Days", ("day", "logs"), logs, text_columns=2)), "days"),
    )
    return Document(
        vehicle.name,
        f"rover-sweep {versions()['rover_sweep']}",
        (_verdict(words, bool(found)), *items([sentence(d.sentence) for d in found])),
        tuple(Section(*section) for section in sections),
        (("../season.html", "Fleet"),),
        (Sentence(versions_words(versions()), "muted"),),
    )


def _verdict(words: str, changed: bool) -> Sentence:
    badge = Badge("changed", "warn") if changed else Badge("unchanged", "good")
    return Sentence(sentence(words), "strong", badge=badge)


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
    return write_file(directory / "season.html", in_html(season_report(season)))


def season_document(season: Season) -> str:
    """season.json: every number of the season."""
    return strict_json({"format": "rover-sweep season", "format_version": 1, **asdict(season)})
