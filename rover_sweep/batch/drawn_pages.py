"""The pages of the vehicles, drawn by the same workers: a picture takes a second."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from typing import Any

from rover_sweep.batch.finished_work import finished
from rover_sweep.report.season.season_page import vehicle_page
from rover_sweep.report.season.season_pictures import shown_courses
from rover_sweep.season.season_result import Season, VehicleSeason


def drawn_pages(season: Season, diagnoses: Mapping[tuple[str, str], str], pool: Executor) -> dict[str, str]:
    """{vehicle: its page}. diagnoses: {(vehicle, day): sentence}."""
    given = {
        v.name: (v, {day: text for (name, day), text in diagnoses.items() if name == v.name})
        for v in season.vehicles
    }
    out = {}
    for name, result in finished(pool, draw_page, given, lambda done, left: None):
        if isinstance(result, Exception):
            raise result
        out[name] = result["page"]
    return out


def draw_page(vehicle: VehicleSeason, diagnoses: Mapping[str, str]) -> dict[str, Any]:
    """{"page": HTML} of a vehicle. diagnoses: {day: sentence}."""
    return {"page": vehicle_page(vehicle, shown_courses(vehicle), diagnoses)}
