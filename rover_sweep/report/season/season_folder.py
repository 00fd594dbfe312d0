"""The folder of a season."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from rover_sweep.files.replaced import write_file
from rover_sweep.report.season.season_columns import as_csv, as_parquet, season_columns
from rover_sweep.report.season.season_page import fleet_page, page_names
from rover_sweep.report.wording.strict_json import strict_json
from rover_sweep.season.measured_log import MeasuredLog
from rover_sweep.season.season_result import Season


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
