"""Diagnose recordings, correct a simulated rover by them, report: for `twin`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.errors import DataRefused, UsageError

if TYPE_CHECKING:
    from rover_sweep.api.diagnosis_input import Material
    from rover_sweep.api.read import Reading
    from rover_sweep.comparison.corrected import Correction, Twin
    from rover_sweep.data.recording import Recording
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.diagnosis.result import Diagnosis
    from sitl.plant.variant import PlantParameters

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
    from rover_sweep.cli.views.interruption import Interruption
    from rover_sweep.cli.views.output import echo_json, narration, print_warnings, results
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.report.comparison.report_folder import write_twin
    from rover_sweep.report.comparison.terminal import twin_summary
    from rover_sweep.report.diagnosis.terminal import WIDTH
    from rover_sweep.report.wording.provenance import provenance

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
    shown.print(twin_summary(found), width=min(shown.width, WIDTH))
    shown.print(f"\nreport: {page}", soft_wrap=True, markup=False)
    shown.print(f"corrected rover: {call.out / 'variant.toml'}", soft_wrap=True, markup=False)
    if as_json:
        echo_json((call.out / "twin.json").read_text(encoding="utf-8"))
    if asked.to_stop():
        raise click.Abort


def _begin(call: TwinCall, vehicle: Vehicle) -> tuple[PlantParameters, tuple[Correction, ...]]:
    """The rover to begin with; one of a name gets the measured numbers of the vehicle file."""
    from rover_sweep.redrive.vehicle_variant import refuse_instant, simulated_rover
    from rover_sweep.twin.simulated_drives import with_measured

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
    from rover_sweep.api.compare import compared
    from rover_sweep.api.read import load_steered
    from rover_sweep.cli.views.output import narration
    from rover_sweep.comparison.common_model import FittedSide
    from rover_sweep.comparison.compare import Compared
    from rover_sweep.twin.loop import twin_of, with_last_drive
    from rover_sweep.twin.simulated_drives import recorded_drives, simulated_drives
    from rover_sweep.twin.variant_file import variant_with_reasons

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

    def compare(simulated: Sequence[Recording], laws: tuple[str, ...]) -> Compared:
        return compared(given.runs, given.held_out, simulated, found, laws, call.seed, fitted=fitted)

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
    from rover_sweep.cli.views.long_work import long_work
    from rover_sweep.diagnosis.settings import DiagnosisSettings

    with long_work("diagnosing") as report:
        return diagnosed(
            given, vehicle, DiagnosisSettings(seed=seed), lambda what, share: report(share, what), stop
        )
