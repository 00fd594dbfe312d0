"""Compare a simulation with diagnosed recordings, write the report, print the summary: for `diagnose`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.api.diagnosis_input import Material
    from rover_sweep.api.read import Reading
    from rover_sweep.data.recording import Recording
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.diagnosis.result import Diagnosis
    from rover_sweep.report.wording.provenance import Provenance

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
    from rover_sweep.api.compare import compared
    from rover_sweep.report.comparison.report_folder import write_comparison
    from rover_sweep.report.comparison.terminal import comparison_summary
    from rover_sweep.report.diagnosis.terminal import WIDTH

    simulated, laws = _driven(drive, vehicle, found) if drive else (given.simulated, None)
    answer = compared(given.runs, given.held_out, simulated, found, laws, seed).answer
    page = write_comparison(answer, out, provenance)
    shown.print("")
    shown.print(comparison_summary(answer), width=min(shown.width, WIDTH))
    shown.print(f"\ncomparison: {page}", soft_wrap=True, markup=False)
    return page.with_suffix(".json")


def _driven(
    drive: SimulatorCall, vehicle: Vehicle, found: Diagnosis
) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
    """(recordings of the simulated rover, the laws that it has)."""
    from rover_sweep.api.read import load_steered
    from rover_sweep.cli.views.output import narration
    from rover_sweep.redrive.vehicle_variant import simulated_rover
    from rover_sweep.twin.loop import laws_of
    from rover_sweep.twin.simulated_drives import recorded_drives, simulated_drives, with_measured

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
