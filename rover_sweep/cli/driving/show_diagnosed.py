"""Diagnose, write the report and print the summary: for `diagnose`, and for `run --diagnose`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.errors import DataRefused

if TYPE_CHECKING:
    from rover_sweep.api.diagnosis_input import Material
    from rover_sweep.cli.driving.show_compared import SimulatorCall
    from rover_sweep.cli.views.interruption import Interruption
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.diagnosis.result import Diagnosis
    from rover_sweep.diagnosis.settings import DiagnosisSettings

CTRL_C = "finishing with the findings so far and their report; press Ctrl-C again to quit without it"


def show_diagnosed(
    given: Material,
    rover: tuple[Vehicle, Path],
    settings: DiagnosisSettings,
    out: Path,
    as_json: bool,
    drive: SimulatorCall | None = None,
) -> None:
    """Diagnose, write the report into `out`, print summary and path; DataRefused if data are refused.

    Simulated runs are compared with the recordings; drive: the simulation to drive for that, if any.
    """
    from datetime import datetime

    from rover_sweep.cli.driving.show_compared import show_compared, with_comparison
    from rover_sweep.cli.views.interruption import Interruption
    from rover_sweep.cli.views.long_work import long_work
    from rover_sweep.cli.views.output import echo_json, narration, print_warnings, results
    from rover_sweep.report.diagnosis.report_folder import write_diagnosis
    from rover_sweep.report.diagnosis.terminal import WIDTH, summary
    from rover_sweep.report.wording.provenance import provenance

    console, shown = narration(), results(as_json)
    print_warnings(console, (*given.runs, *given.held_out))
    command = " ".join(["rover-sweep", *sys.argv[1:]])
    origin = given.origin(provenance(*rover, given.held_out, command, datetime.now().astimezone()), settings)
    with Interruption(lambda: console.print(CTRL_C, style="yellow")) as asked:
        found = _computed(given, rover[0], settings, asked)
        shown.print(summary(found), width=min(shown.width, WIDTH))
        with long_work("writing the report") as report:
            files = write_diagnosis(found, out, origin, report)
    interrupted = asked.to_stop()
    shown.print(f"\nreport: {files.page}", soft_wrap=True, markup=False)
    if files.variant:
        shown.print(f"as a simulated rover: {files.variant}", soft_wrap=True, markup=False)
    document = files.document.read_text(encoding="utf-8")
    if (given.simulated or drive) and found.model is not None and not interrupted:
        compared = show_compared(given, rover[0], found, origin.provenance, out, drive, settings.seed, shown)
        document = with_comparison(document, compared) if as_json else document
    if as_json:
        echo_json(document)
    if found.verdict == "refused":
        raise DataRefused("the data were refused; see the reasons above or in the report")
    if interrupted:
        raise click.Abort  # so that a script sees from the exit code that the search was stopped early


def _computed(
    given: Material, vehicle: Vehicle, settings: DiagnosisSettings, asked: Interruption
) -> Diagnosis:
    """The diagnosis, with a progress bar; with the findings so far once a stop is asked for."""
    from rover_sweep.api.diagnosis_input import diagnosed
    from rover_sweep.cli.views.long_work import long_work

    with long_work("diagnosing") as report:
        return diagnosed(given, vehicle, settings, lambda what, share: report(share, what), asked.to_stop)
