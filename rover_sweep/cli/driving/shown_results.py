"""Identify models, write the report and print the comparison: for `identify`, `run` and `dry-run`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.errors import DataRefused, UsageError

if TYPE_CHECKING:
    from rover_sweep.api.diagnosis_input import Material
    from rover_sweep.api.read import Reading
    from rover_sweep.batch.measured_logs import Progress
    from rover_sweep.cli.views.asking import Interruption
    from rover_sweep.comparison.answer import Correction, Twin
    from rover_sweep.data.recording import Recording, ThrottleRun
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.diagnosis.result import Diagnosis, DiagnosisSettings
    from rover_sweep.identification.grouping import Settings
    from rover_sweep.identification.identify_speed import SpeedResult
    from rover_sweep.identification.model_results import ModelResult
    from rover_sweep.identification.pipeline import Identification
    from rover_sweep.identification.state_space import ModelStructure
    from rover_sweep.report.document import Table
    from rover_sweep.report.wording import Provenance
    from sitl.plant.variant import PlantParameters


def show_identified(
    sweeps: tuple[Recording, ...],
    checks: tuple[Recording, ...],
    rover: tuple[Vehicle, Path],
    settings: Settings,
    out: Path,
    as_json: bool,
    full: bool = False,
    more: Callable[[Identification], Table | None] | None = None,
    structures: Sequence[ModelStructure] = (),
    units: str = "SI",
) -> None:
    """Identify, print the tables and the answer, write the report into `out`, print its path.

    more: a table below the numbers; full: all tables. structures: the user's own. units: of accelerations,
    "SI" or "paper". as_json: identification.json on stdout, everything else on stderr.
    """
    from rover_sweep.api.identify import identified as identified_models
    from rover_sweep.cli.views.asking import long_work
    from rover_sweep.cli.views.output import echo_json, narration, print_warnings, results
    from rover_sweep.report.identification.report import identification_report
    from rover_sweep.report.identification.sentences import first_numbers
    from rover_sweep.report.on_terminal import on_terminal
    from rover_sweep.report.wording import SHOWN_UNITS

    console, shown = narration(), results(as_json)
    print_warnings(console, (*sweeps, *checks))
    command = " ".join(["rover-sweep", *sys.argv[1:]])
    with long_work(f"identifying from {len(sweeps)} run{'s' if len(sweeps) != 1 else ''}") as work:

        def show_first(models: Mapping[str, ModelResult]) -> None:
            if settings.bootstrap and (words := first_numbers(models)):
                work.tell(words)

        result = identified_models(
            sweeps, checks, rover, settings, structures, command=command, fitted=show_first
        )
    table = more(result) if more else None
    document = identification_report(result, result.origin, SHOWN_UNITS[units], more=table)
    shown.print(on_terminal(document, full, answer_last=True))
    with long_work("writing the report") as progress:
        files = result.report(out, lambda share, what: progress(share, f"writing {what}"), units)
    if not full:
        shown.print("all models, costs and handling: in the report, or here with --full", style="dim")
    shown.print(f"report: {files.page}", soft_wrap=True, markup=False)
    if as_json:
        echo_json(files.document.read_text(encoding="utf-8"))


# Diagnose, write the report and print the summary: for `diagnose`, and for `run --diagnose`.


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

    from rover_sweep.cli.views.asking import Interruption, long_work
    from rover_sweep.cli.views.output import echo_json, narration, print_warnings, results
    from rover_sweep.report.diagnosis.report import diagnosis_report, write_diagnosis
    from rover_sweep.report.on_terminal import WIDTH, on_terminal
    from rover_sweep.report.wording import provenance

    console, shown = narration(), results(as_json)
    print_warnings(console, (*given.runs, *given.held_out))
    command = " ".join(["rover-sweep", *sys.argv[1:]])
    origin = given.origin(provenance(*rover, given.held_out, command, datetime.now().astimezone()), settings)
    with Interruption(lambda: console.print(CTRL_C, style="yellow")) as asked:
        found = _computed(given, rover[0], settings, asked)
        shown.print(on_terminal(diagnosis_report(found)), width=min(shown.width, WIDTH))
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
    from rover_sweep.cli.views.asking import long_work

    with long_work("diagnosing") as report:
        return diagnosed(given, vehicle, settings, lambda what, share: report(share, what), asked.to_stop)


# Compare a simulation with diagnosed recordings, write the report, print the summary: for `diagnose`.


SIMULATORS = ("plant", "embedded", "ardurover")


@dataclass(frozen=True)
class SimulatorCall:
    """A simulation to drive with the steering and speed of the recordings.

    sources: of all recordings. variant: of the simulated rover, None for the nominal one with the numbers of
    the vehicle file. out: folder, whose `simulated` gets its recordings.
    """

    sources: tuple[str, ...]
    simulator: str
    variant: str | None
    ardurover: Path | None
    out: Path
    seed: int
    reading: Reading


def simulator_of(simulated: Sequence[str], variant: str | None) -> str | None:
    """The simulator that --simulation names, None where it names recordings. UsageError for a mixture."""
    named = [s for s in simulated if s in SIMULATORS]
    if named and len(simulated) > 1:
        raise UsageError(
            f"--simulation {', '.join(simulated)}: give one of {', '.join(SIMULATORS)}, or recordings of a "
            "simulation"
        )
    if variant and not named:
        raise UsageError(f"--variant {variant} needs --simulation plant, embedded or ardurover")
    return named[0] if named else None


def show_compared(
    given: Material,
    vehicle: Vehicle,
    found: Diagnosis,
    provenance: Provenance,
    out: Path,
    drive: SimulatorCall | None,
    seed: int,
    shown: Any,
) -> Path:
    """Compare, write comparison.html and .json, print the summary; the path of comparison.json."""
    from rover_sweep.api.diagnose import compared
    from rover_sweep.report.comparison.report import comparison_report, write_comparison
    from rover_sweep.report.on_terminal import WIDTH, on_terminal

    simulated, laws = _driven(drive, vehicle, found) if drive else (given.simulated, None)
    answer = compared(given.runs, given.held_out, simulated, found, laws, seed).answer
    page = write_comparison(answer, out, provenance)
    shown.print("")
    shown.print(on_terminal(comparison_report(answer, provenance)), width=min(shown.width, WIDTH))
    shown.print(f"\ncomparison: {page}", soft_wrap=True, markup=False)
    return page.with_suffix(".json")


def _driven(
    drive: SimulatorCall, vehicle: Vehicle, found: Diagnosis
) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
    """(recordings of the simulated rover, the laws that it has)."""
    from rover_sweep.api.read import load_steered
    from rover_sweep.cli.views.output import narration
    from rover_sweep.redrive.recorded_course import simulated_rover
    from rover_sweep.twin.loop import laws_of, recorded_drives, simulated_drives, with_measured

    console = narration()

    def say(words: str) -> None:
        console.print(words, soft_wrap=True, markup=False)

    rover = simulated_rover(drive.variant or "nominal", None)
    rover = rover if drive.variant else with_measured(rover, vehicle)[0]
    say(f"driving the simulated rover ({drive.simulator}) like the recordings")
    folder = drive.out / "simulated"
    drives = recorded_drives(drive.sources, drive.reading.columns)
    paths = simulated_drives(drives, rover, folder, drive.simulator, drive.ardurover, drive.seed, say)
    reading = replace(drive.reading, columns=None)
    assert found.model is not None
    return load_steered(paths, vehicle, reading, drive.sources), laws_of(rover, found.model)


def with_comparison(document: str, compared: Path) -> str:
    """diagnosis.json with the comparison under the key `comparison`."""
    import json

    whole = json.loads(document)
    whole["comparison"] = json.loads(compared.read_text(encoding="utf-8"))
    return json.dumps(whole, indent=1, ensure_ascii=False)


# Diagnose recordings, correct a simulated rover by them, report: for `twin`.


Stop = Callable[[], bool]


@dataclass(frozen=True)
class TwinCall:
    """What the user asked for. simulator: that drives the last round; out: the folder."""

    runs: tuple[str, ...]
    held_out: tuple[str, ...]
    vehicle: Path
    variant: str
    simulator: str
    ardurover: Path | None
    seed: int
    reading: Reading
    out: Path


def show_twin(call: TwinCall, as_json: bool) -> None:
    """Correct, write the report, print the summary; DataRefused where the recordings are refused."""
    from rover_sweep.api.diagnosis_input import material
    from rover_sweep.api.read import load_steered
    from rover_sweep.cli.views.asking import Interruption
    from rover_sweep.cli.views.output import echo_json, narration, print_warnings, results
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.report.comparison.report import twin_report, write_twin
    from rover_sweep.report.on_terminal import WIDTH, on_terminal
    from rover_sweep.report.wording import provenance

    console, shown = narration(), results(as_json)
    vehicle = load(call.vehicle)
    rover, measured = _begin(call, vehicle)
    runs = load_steered(call.runs, vehicle, call.reading, call.held_out)
    held = load_steered(call.held_out, vehicle, call.reading, call.runs) if call.held_out else ()
    given = material(runs, held)
    print_warnings(console, (*given.runs, *given.held_out))
    words = "stopping with the corrections so far; press Ctrl-C again to quit without a report"
    with Interruption(lambda: console.print(words, style="yellow")) as asked:
        found = _twin(call, vehicle, rover, measured, given, asked.to_stop)
    command = " ".join(["rover-sweep", *sys.argv[1:]])
    origin = provenance(vehicle, call.vehicle, given.held_out, command, datetime.now().astimezone())
    page = write_twin(found, call.out, origin)
    shown.print(on_terminal(twin_report(found, origin)), width=min(shown.width, WIDTH))
    shown.print(f"\nreport: {page}", soft_wrap=True, markup=False)
    shown.print(f"corrected rover: {call.out / 'variant.toml'}", soft_wrap=True, markup=False)
    if as_json:
        echo_json((call.out / "twin.json").read_text(encoding="utf-8"))
    if asked.to_stop():
        raise click.Abort


def _begin(call: TwinCall, vehicle: Vehicle) -> tuple[PlantParameters, tuple[Correction, ...]]:
    """The rover to begin with; one of a name gets the measured numbers of the vehicle file."""
    from rover_sweep.redrive.recorded_course import refuse_instant, simulated_rover
    from rover_sweep.twin.loop import with_measured

    rover = simulated_rover(call.variant, None)
    if call.simulator != "plant":
        refuse_instant(rover, call.simulator)
    if call.variant.endswith(".toml"):
        return rover, ()
    try:
        return with_measured(rover, vehicle)
    except ValueError as error:  # numbers that are valid one by one but not together
        raise UsageError(f"{call.vehicle}: {error}") from error


def _twin(
    call: TwinCall,
    vehicle: Vehicle,
    rover: PlantParameters,
    measured: tuple[Correction, ...],
    given: Material,
    stop: Stop,
) -> Twin:
    """The recordings diagnosed, and the rover corrected by them; with the text of its variant file."""
    from rover_sweep.api.diagnose import compared
    from rover_sweep.api.read import load_steered
    from rover_sweep.cli.views.output import narration
    from rover_sweep.comparison.common_model import FittedSide
    from rover_sweep.comparison.compare import Compared
    from rover_sweep.twin.loop import (
        measured_differences,
        recorded_drives,
        simulated_drives,
        twin_of,
        variant_with_reasons,
        with_last_drive,
    )

    console, count = narration(), 0
    drives = recorded_drives((*call.runs, *call.held_out), call.reading.columns)
    fitted: dict[tuple[str, ...], FittedSide] = {}
    found = _diagnosed(given, vehicle, call.seed, stop)
    if found.model is None:
        raise DataRefused(f"the recordings were refused: {found.sentence}")

    def say(words: str) -> None:
        console.print(words, soft_wrap=True, markup=False)

    say(f"recordings: {found.sentence}")

    def drive(rover: PlantParameters, simulator: str = "plant") -> Sequence[Recording]:
        nonlocal count
        count += 1
        folder = call.out / "simulated" / f"drive{count}"
        paths = simulated_drives(
            drives, rover, folder, simulator, call.ardurover, call.seed + 10 * count, say
        )
        return load_steered(paths, vehicle, replace(call.reading, columns=None), (*call.runs, *call.held_out))

    def compare(
        simulated: Sequence[Recording],
        laws: tuple[str, ...],
        rover: PlantParameters,
        changed: Collection[str],
    ) -> Compared:
        known = measured_differences(vehicle, rover)
        return compared(
            given.runs,
            given.held_out,
            simulated,
            found,
            laws,
            call.seed,
            fitted=fitted,
            measured=known,
            changed=changed,
        )

    twin, rover = twin_of(rover, measured, found.model, drive, compare, say, stop)
    if call.simulator != "plant" and not stop():
        say(f"driving the corrected rover on {call.simulator}")
        twin = with_last_drive(
            twin, rover, found.model, lambda r: drive(r, call.simulator), compare, call.simulator
        )
    text = variant_with_reasons(rover, twin.corrections, call.variant)
    remarks = tuple(r for r in found.remarks if "held out" in r)
    return replace(twin, variant=text, remarks=(*twin.remarks, *remarks))


def _diagnosed(given: Material, vehicle: Vehicle, seed: int, stop: Stop) -> Diagnosis:
    from rover_sweep.api.diagnosis_input import diagnosed
    from rover_sweep.cli.views.asking import long_work
    from rover_sweep.diagnosis.result import DiagnosisSettings

    with long_work("diagnosing") as report:
        return diagnosed(
            given, vehicle, DiagnosisSettings(seed=seed), lambda what, share: report(share, what), stop
        )


# Measure the logs of a fleet, find its drifts, write the report: for `batch`.


KEPT = "measured"  # folder of the saved values


@dataclass(frozen=True)
class BatchCall:
    """What the user asked for. scheduler: of a Dask cluster; workers: local processes; out: the folder."""

    logs: tuple[str, ...]
    vehicles: Path | None
    scheduler: str | None
    workers: int | None
    diagnose: bool
    parquet: bool
    out: Path


def show_season(call: BatchCall, as_json: bool) -> None:
    """Measure, analyse, write, print the summary."""
    from rover_sweep.batch.measured_logs import (
        files_beside,
        log_sources,
        measured_logs,
        read_vehicle_files,
        workers,
    )
    from rover_sweep.batch.season_of_logs import diagnosed_days, drawn_pages, season_of_logs
    from rover_sweep.cli.views.output import echo_json, results
    from rover_sweep.report.on_terminal import on_terminal
    from rover_sweep.report.season.report import season_document, season_report, write_season

    sources = log_sources(call.logs)
    files = read_vehicle_files(call.vehicles) if call.vehicles else files_beside(sources)
    with workers(call.workers, call.scheduler) as pool:
        with _progress("log", len(sources)) as progress:
            logs = measured_logs(sources, files, call.out / KEPT, pool, progress)
        found = season_of_logs(logs, files)
        said = {}
        if call.diagnose:
            with _progress("day", sum(len(v.logs) for v in found.vehicles)) as progress:
                said = diagnosed_days(found, logs, files, call.out, pool, progress)
        pages = drawn_pages(found, said, pool)
    page = write_season(found, logs, pages, call.out, call.parquet)
    shown = results(as_json)
    shown.print(on_terminal(season_report(found)))
    shown.print(f"report: {page}", markup=False, soft_wrap=True)
    if as_json:
        echo_json(season_document(found))


@contextmanager
def _progress(what: str, count: int) -> Iterator[Progress]:
    """A bar with an estimate on a terminal; a line each tenth elsewhere."""
    import time

    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from rover_sweep.cli.views.output import narration

    console = narration()
    started = time.monotonic()
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
        console=console,
        transient=True,
    ) as bar:
        task = bar.add_task(f"{what}s", total=count)

        def show(done: int, left: int) -> None:
            if not done and left < count:
                console.print(f"{count - left} of {count} {what}s were done before")
            bar.update(task, completed=done, total=left)
            if not console.is_terminal and done and (done == left or done % max(1, left // 10) == 0):
                rest = (time.monotonic() - started) / done * (left - done)
                click.echo(f"{done} of {left} {what}s done, about {rest:.0f} s left", err=True)

        yield show


# Identify the response of the speed from throttle sweeps, print the answer, write the report.


def show_speed(sweeps: Sequence[ThrottleRun], out: Path, as_json: bool, alone: bool) -> SpeedResult:
    """Print the answer and write speed.html and speed.json into `out`; the result.

    as_json: everything on stderr. alone: there are no other runs, so with as_json speed.json goes to stdout.
    """
    from rover_sweep.api.speed import speed_findings, write_speed_report
    from rover_sweep.cli.views.output import echo_json, results
    from rover_sweep.identification.identify_speed import identify_speed
    from rover_sweep.report.on_terminal import on_terminal
    from rover_sweep.report.speed.report import speed_report

    shown = results(as_json)
    result = identify_speed(sweeps)
    shown.print(on_terminal(speed_report(speed_findings(result, out))))
    files = write_speed_report(result, out)
    shown.print(f"speed: {files.page}; next: rover-sweep gains {out}", soft_wrap=True, markup=False)
    if as_json and alone:
        echo_json(files.document.read_text(encoding="utf-8"))
    return result


def add_steering(result: SpeedResult | None, out: Path) -> None:
    """Write speed.html again, with the limits that follow from the steering's results in `out`."""
    from rover_sweep.api.speed import write_speed_report

    if result is not None:
        write_speed_report(result, out)
