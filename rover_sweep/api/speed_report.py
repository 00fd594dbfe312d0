"""The folder of a speed result: speed.html for people, speed.json for programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rover_sweep.api.gains import steering_gains
from rover_sweep.api.speed import proposed_speed, write_speed
from rover_sweep.errors import RoverSweepError
from rover_sweep.files.replaced import remove_file, write_file
from rover_sweep.gains.steering_limits import SteeringLimits, steering_limits
from rover_sweep.identification.speed.identify_speed import SpeedResult
from rover_sweep.report.speed.speed_json import speed_document
from rover_sweep.report.speed.speed_page import SpeedFindings, speed_page


@dataclass(frozen=True)
class SpeedFiles:
    """Paths of the written files."""

    directory: Path
    document: Path
    page: Path


def write_speed_report(result: SpeedResult, folder: Path) -> SpeedFiles:
    """Write speed.html, then speed.json, into a folder, which is created if missing.

    If the folder has the results of steering sweeps too, the page has the steering's limits from them.
    """
    parameters = result.runs[0].parameters
    proposal = proposed_speed(speed_document(result), parameters, "the parameters of the runs")
    findings = SpeedFindings(
        result, proposal, _limits(folder, parameters), parameters, (folder / "report.html").is_file()
    )
    html = speed_page(findings)
    remove_file(folder / "speed.json")
    folder.mkdir(parents=True, exist_ok=True)
    page = write_file(folder / "speed.html", html)
    return SpeedFiles(folder, write_speed(result, folder), page)


def _limits(folder: Path, parameters: Mapping[str, float]) -> SteeringLimits | None:
    """From an identification in the folder; None without one that supports gains."""
    if not (folder / "identification.json").is_file():
        return None
    try:
        return steering_limits(
            steering_gains(folder, None, None, parameters, "the parameters of the runs", None)
        )
    except RoverSweepError:
        return None
