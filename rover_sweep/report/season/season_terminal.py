"""The summary of a season on a terminal."""

from __future__ import annotations

from rich.console import Console

from rover_sweep.report.wording.effect_names import sentence
from rover_sweep.season.season_result import Season


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
