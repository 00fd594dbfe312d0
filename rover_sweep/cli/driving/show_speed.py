"""Identify the response of the speed from throttle sweeps, print the answer, write the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rover_sweep.data.throttle_run import ThrottleRun
    from rover_sweep.identification.speed.identify_speed import SpeedResult


def show_speed(sweeps: Sequence[ThrottleRun], out: Path, as_json: bool, alone: bool) -> SpeedResult:
    """Print the answer and write speed.html and speed.json into `out`; the result.

    as_json: everything on stderr. alone: there are no other runs, so with as_json speed.json goes to stdout.
    """
    from rover_sweep.api.speed_report import write_speed_report
    from rover_sweep.cli.views.output import echo_json, results
    from rover_sweep.identification.speed.identify_speed import identify_speed
    from rover_sweep.report.speed.speed_terminal import speed_answer

    shown = results(as_json)
    result = identify_speed(sweeps)
    for line in speed_answer(result):
        shown.print(line, soft_wrap=True, markup=False)
    files = write_speed_report(result, out)
    shown.print(f"speed: {files.page}; next: rover-sweep gains {out}", soft_wrap=True, markup=False)
    if as_json and alone:
        echo_json(files.document.read_text(encoding="utf-8"))
    return result


def add_steering(result: SpeedResult | None, out: Path) -> None:
    """Write speed.html again, with the limits that follow from the steering's results in `out`."""
    from rover_sweep.api.speed_report import write_speed_report

    if result is not None:
        write_speed_report(result, out)
