"""The pages of a season, each one self-contained HTML file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from rover_sweep.report.charts.shown_chart import ShownChart, by_section
from rover_sweep.report.identification.comparison import Table
from rover_sweep.report.season.season_tables import (
    day_table,
    diagnosis_table,
    drift_table,
    parameter_change_table,
    refused_table,
    season_value_table,
)
from rover_sweep.report.templates import environment
from rover_sweep.report.wording.effect_names import sentence
from rover_sweep.report.wording.provenance import versions
from rover_sweep.season.season_result import Drift, Season, VehicleSeason

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
