"""Identify models, write the report and print the comparison: for `identify`, `run` and `dry-run`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path

import click
from rich.console import Console

from rover_sweep.api.diagnose import compared
from rover_sweep.api.diagnosis_input import Material, diagnosed, why_not_diagnosed
from rover_sweep.api.identify import identified as identified_models
from rover_sweep.api.speed import speed_findings, write_speed_report
from rover_sweep.cli.views.asking import Interruption, long_work
from rover_sweep.cli.views.output import echo_json, narration, print_warnings, results
from rover_sweep.data.recording import Recording, ThrottleRun
from rover_sweep.data.vehicle_file import Vehicle
from rover_sweep.diagnosis.result import Diagnosis, DiagnosisSettings
from rover_sweep.errors import DataRefused
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.identify_speed import SpeedResult, identify_speed
from rover_sweep.identification.model_results import ModelResult
from rover_sweep.identification.pipeline import Identification
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.report.comparison_report import comparison_report, write_comparison
from rover_sweep.report.diagnosis.report import diagnosis_report, write_diagnosis
from rover_sweep.report.document import Table
from rover_sweep.report.identification.report import identification_report
from rover_sweep.report.identification.sentences import first_numbers
from rover_sweep.report.on_terminal import WIDTH, on_terminal
from rover_sweep.report.speed_report import speed_report
from rover_sweep.report.wording import SHOWN_UNITS, Provenance, provenance

Rover = tuple[Vehicle, Path]


def own_command() -> str:
    """The command line of this call, for the report."""
    return " ".join(["rover-sweep", *sys.argv[1:]])


def made_now(rover: Rover, held_out: Sequence[Recording]) -> Provenance:
    """The origin of a result of this call."""
    return provenance(*rover, held_out, own_command(), datetime.now().astimezone())


def show_identified(
    sweeps: tuple[Recording, ...],
    checks: tuple[Recording, ...],
    rover: Rover,
    settings: Settings,
    out: Path,
    as_json: bool,
    full: bool = False,
    more: Callable[[Identification], Table | None] | None = None,
    structures: Sequence[ModelStructure] = (),
    units: str = "SI",
    again: str = "",
) -> None:
    """Identify, print the tables and the answer, write the report into `out`, print its path.

    more: a table below the numbers; full: all tables. structures: the user's own. units: of accelerations,
    "SI" or "paper". as_json: identification.json on stdout, everything else on stderr. again: the runs and
    their vehicle file as arguments, for the next command.
    """
    console, shown = narration(), results(as_json)
    print_warnings(console, (*sweeps, *checks))
    with long_work(f"identifying from {len(sweeps)} run{'s' if len(sweeps) != 1 else ''}") as work:

        def show_first(models: Mapping[str, ModelResult]) -> None:
            if settings.bootstrap and (words := first_numbers(models)):
                work.tell(words)

        result = identified_models(
            sweeps, checks, rover, settings, structures, command=own_command(), fitted=show_first
        )
    table = more(result) if more else None
    document = identification_report(result, result.origin, SHOWN_UNITS[units], more=table)
    shown.print(on_terminal(document, full, answer_last=True))
    with long_work("writing the report") as progress:
        files = result.report(out, lambda step, share: progress(f"writing {step}", share), units)
    if not full:
        shown.print("all models, costs and handling: in the report, or here with --full", style="dim")
    shown.print(f"report: {files.page}", soft_wrap=True)
    if again and (why := why_not_diagnosed(sweeps, checks)):
        shown.print(f"next: give other runs, as these would be refused: {why}", soft_wrap=True)
    elif again:
        steps = [f"rover-sweep diagnose {again} --out {out}"]
        steps += [f"rover-sweep gains {out}"] if result.recommended else []
        shown.print(f"next: {'; '.join(steps)}", soft_wrap=True)
    if as_json:
        echo_json(files.document.read_text(encoding="utf-8"))


# of a simulated rover, with the diagnosed model; (its recordings, the laws that it has)
Drive = Callable[["Diagnosis"], "tuple[tuple[Recording, ...], tuple[str, ...]]"]
CTRL_C = "finishing with the findings so far and their report; press Ctrl-C again to quit without it"


def show_diagnosed(
    given: Material,
    rover: Rover,
    settings: DiagnosisSettings,
    out: Path,
    as_json: bool,
    drive: Drive | None = None,
    full: bool = False,
) -> None:
    """Diagnose, write the report into `out`, print summary and path; DataRefused if data are refused.

    Simulated runs are compared with the recordings; drive: the simulation to drive for that. The comparison
    is then the answer, and the diagnosis is printed only with `full`, which also shows all tables.
    """
    console, shown = narration(), results(as_json)
    print_warnings(console, (*given.runs, *given.held_out))
    origin = given.origin(made_now(rover, given.held_out), settings)
    with Interruption(lambda: console.print(CTRL_C, style="yellow")) as asked:
        found = diagnosis_of(given, rover[0], settings, asked.to_stop)
        comparing = bool(given.simulated or drive) and found.model is not None
        if full or not comparing or asked.to_stop():
            shown.print(on_terminal(diagnosis_report(found), full), width=min(shown.width, WIDTH))
        with long_work("writing the report") as progress:
            files = write_diagnosis(found, out, origin, progress)
    interrupted = asked.to_stop()
    document = files.document.read_text(encoding="utf-8")
    if comparing and not interrupted:
        page = show_compared(given, found, origin.provenance, out, drive, settings.seed, shown)
        if as_json:  # diagnosis.json with the comparison under a key of its own
            comparison = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))
            document = json.dumps(
                json.loads(document) | {"comparison": comparison}, indent=1, ensure_ascii=False
            )
        shown.print(f"diagnosis of the recordings alone: {files.page}, or here with --full", soft_wrap=True)
    else:
        if not full:
            shown.print("\nall that could still hide: in the report, or here with --full", style="dim")
        shown.print(f"report: {files.page}", soft_wrap=True)
    if files.variant:
        shown.print(f"as a simulated rover: {files.variant}", soft_wrap=True)
    if found.verdict in ("none", "explained"):
        shown.print(f"next: rover-sweep gains {out}", soft_wrap=True)
    elif found.verdict != "refused":
        shown.print(f"next: rover-sweep plan --vehicle {rover[1]} (more runs to drive)", soft_wrap=True)
    if as_json:
        echo_json(document)
    if found.verdict == "refused":
        raise DataRefused("the data were refused; see the reasons above or in the report")
    if interrupted:
        raise click.Abort  # so that a script sees from the exit code that the search was stopped early


def diagnosis_of(
    given: Material,
    vehicle: Vehicle,
    settings: DiagnosisSettings,
    stop: Callable[[], bool] | None = None,
    what: str = "diagnosing",
) -> Diagnosis:
    """The diagnosis, with its progress on stderr; with the findings so far once a stop is asked for."""
    with long_work(what) as report:
        return diagnosed(given, vehicle, settings, report, stop)


def show_compared(
    given: Material,
    found: Diagnosis,
    made: Provenance,
    out: Path,
    drive: Drive | None,
    seed: int,
    shown: Console,
) -> Path:
    """Compare, write comparison.html and .json, print the summary; the path of the page."""
    simulated, laws = drive(found) if drive else (given.simulated, None)
    answer = compared(given.runs, given.held_out, simulated, found, laws, seed).answer
    page = write_comparison(answer, out, made)
    shown.print("")
    shown.print(on_terminal(comparison_report(answer, made)), width=min(shown.width, WIDTH))
    shown.print(f"\ncomparison: {page}", soft_wrap=True)
    return page


def show_speed(sweeps: Sequence[ThrottleRun], out: Path, as_json: bool, alone: bool) -> SpeedResult:
    """Print the answer and write speed.html and speed.json into `out`; the result.

    as_json: everything on stderr. alone: there are no other runs, so with as_json speed.json goes to stdout.
    """
    shown = results(as_json)
    result = identify_speed(sweeps)
    findings = speed_findings(result, out)
    shown.print(on_terminal(speed_report(findings)))
    files = write_speed_report(findings, out)
    shown.print(f"speed: {files.page}; next: rover-sweep gains {out}", soft_wrap=True)
    if as_json and alone:
        echo_json(files.document.read_text(encoding="utf-8"))
    return result


def add_steering(result: SpeedResult | None, out: Path) -> None:
    """Write speed.html again, with the limits that follow from the steering's results in `out`."""
    if result is not None:
        write_speed_report(speed_findings(result, out), out)
