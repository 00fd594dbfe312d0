"""Prints and writes what any driving shows of the steering, where there are no sweeps or no vehicle file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rover_sweep.api.driving import DrivingIdentification
    from rover_sweep.api.read import Reading


def driving_of(
    runs: Sequence[str], reading: Reading, wheelbase: float | None, vehicle: Path | None = None
) -> DrivingIdentification:
    """What the runs show as any driving; DataRefused where they lack what is needed."""
    from rover_sweep.api.driving import identify_driving
    from rover_sweep.cli.views.asking import long_work
    from rover_sweep.errors import UsageError

    if reading.servo:
        raise UsageError("--servo-telemetry needs a vehicle file and sweeps; omit it, or give --vehicle")
    with long_work("reading the driving"):
        return identify_driving(
            *runs, columns=reading.columns, wheelbase=wheelbase, vehicle=vehicle, system=reading.system
        )


def show_instead(
    runs: Sequence[str], reading: Reading, vehicle: Path, out: Path, as_json: bool, why: str
) -> bool:
    """Show the answer of the driving, if it has one; else return False. why: no models can be identified."""
    answer = driving_of(runs, reading, None, vehicle)
    says = answer.level != "none" or bool(answer.each)
    if says:
        known = "This is what the driving shows, with the numbers of the vehicle file."
        show_driving(answer, out, as_json, f"No models: {why}. {known}")
    return says


def show_driving(answer: DrivingIdentification, out: Path, as_json: bool, why: str) -> None:
    """Print the answer, write driving.html and driving.json into `out`. why: no models are identified."""
    from rover_sweep.cli.views.output import echo_json, narration, results
    from rover_sweep.report.driving import driving_report
    from rover_sweep.report.on_terminal import on_terminal

    narration().print(why, style="yellow", soft_wrap=True)
    shown = results(as_json)
    page = driving_report(answer, ", ".join(answer.sources), answer.read)
    shown.print(on_terminal(page, answer_last=True))
    files = answer.report(out)
    shown.print(f"report: {files.page}", soft_wrap=True)
    if not answer.foreign:  # no sweep can be sent to another system
        shown.print("next: rover-sweep design (the sweeps that show tyres and inertia)", soft_wrap=True)
    if as_json:
        echo_json(files.document.read_text(encoding="utf-8"))
