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

from rover_sweep.data.results import number
from rover_sweep.errors import missing_extra
from rover_sweep.files.replaced import write_file
from rover_sweep.report.charts.chart import ChartPlan
from rover_sweep.report.charts.response_charts import season_chart
from rover_sweep.report.document import Badge, Cell, Document, Figures, Section, Sentence, Table, items, some
from rover_sweep.report.in_html import in_html
from rover_sweep.report.wording import count, sentence, strict_json, symbol, unit, versions, versions_words
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
    small = "Within normal tolerance, or on one day only"
    return Document(
        "Season of the fleet",
        f"rover-sweep {versions()['rover_sweep']}",
        (
            _verdict(season.sentence, bool(season.drifts)),
            *items([sentence(d.sentence) for d in drifts if d.counts or d in follow]),
            *(Sentence(words, "warn", level="terminal") for words in refused),
        ),
        (
            Section("Vehicles", some(_vehicle_table(season)), "vehicles", level="page"),
            Section("What changed", some(drift_table(season.drifts, "What changed")), "drifts", level="page"),
            Section(
                "What changed with them", some(drift_table(follow, "At the same time")), "with", level="page"
            ),
            Section(small, some(drift_table(minor, small)), "minor", level="page"),
            Section("Logs that could not be used", some(refused_table(season)), "refused", level="page"),
        ),
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
    return Document(
        vehicle.name,
        f"rover-sweep {versions()['rover_sweep']}",
        (_verdict(words, bool(found)), *items([sentence(d.sentence) for d in found])),
        (
            Section("What changed", some(drift_table(vehicle.drifts, "What changed")), "drifts"),
            Section("Day by day", some(courses), "courses"),
            Section("Values", some(season_value_table(vehicle)), "values"),
            Section(
                "Parameters that changed", some(parameter_change_table(vehicle.parameters)), "parameters"
            ),
            Section("Diagnosis of each day", some(diagnosis_table(diagnoses)), "diagnoses"),
            Section("Days and logs", (*remarks, day_table(vehicle)), "days"),
        ),
        (("../season.html", "Fleet"),),
        (Sentence(versions_words(versions()), "muted"),),
    )


def _verdict(words: str, changed: bool) -> Sentence:
    badge = Badge("changed", "warn") if changed else Badge("unchanged", "good")
    return Sentence(sentence(words), "strong", badge=badge)


def _vehicle_table(season: Season) -> Table:
    names = page_names(season)
    rows = tuple(
        (
            Cell(v.name, link=f"vehicles/{names[v.name]}.html"),
            Cell(", ".join(d.quantity for d in v.drifts if d.counts) or "–"),
            Cell(str(len(v.logs))),
            Cell(str(sum(map(len, v.logs.values())))),
        )
        for v in season.vehicles
    )
    return Table("Vehicles", ("vehicle", "changed", "days", "logs"), rows, text_columns=2)


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
