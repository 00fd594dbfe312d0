"""`rover-sweep diagnose`: find effects in the recorded runs that the model leaves out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.driving_options import ARDUROVER, SIMULATORS, SimulationOptions, simulator_option
from rover_sweep.cli.options import (
    EFFECTS,
    FILE,
    FOLDER,
    READING,
    REPORT,
    VEHICLE,
    Grouped,
    argument,
    check_report_folder,
    check_writable,
    gathered,
    option,
    options,
    vehicle_path,
)
from rover_sweep.cli.views.output import echo_json, narration, print_warnings, results, say_next
from rover_sweep.errors import DataRefused, UsageError

if TYPE_CHECKING:
    from rover_sweep.api.diagnosis_input import Material
    from rover_sweep.api.read import Reading
    from rover_sweep.comparison.answer import Correction, Twin
    from rover_sweep.data.recording import Recording
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.diagnosis.result import Baseline, Diagnosis
    from sitl.plant.variant import PlantParameters

RANDOM = option("Random seed.", click.IntRange(min=0), default=1)
_BASELINE = option(
    "Baseline model to test (default: roll-yaw, or less if the runs do not determine roll or tyres).",
    click.Choice(("roll-yaw", "bicycle", "lumped", "kinematic")),
)


_SIMULATION = gathered(
    SimulationOptions,
    simulator=simulator_option(None, SIMULATORS),
    variant=option(
        "Simulated rover of --simulator, as in redrive (default: nominal, with the vehicle file's numbers).",
        metavar="NAME|FILE",
    ),
    seed=RANDOM,
)


@click.command(
    cls=Grouped,
    groups={
        "Runs": "vehicle_file hold_out columns",
        "Results": "out full as_json",
        "What is tested": "baseline model only without time_limit",
        "Comparison with a simulation": "simulation simulator variant ardurover",
    },
)
@options
def diagnose(
    runs: tuple[str, ...] = argument("RUN...", nargs=-1, required=True),
    vehicle_file: str | None = VEHICLE,
    baseline: Baseline | None = _BASELINE,
    model: str | None = option("Test an identified model: the identification.json of a report.", FILE),
    simulation: tuple[str, ...] = option(
        "Recording of a simulation with the steering of a RUN, to compare; may be repeated.",
        metavar="RUN",
        multiple=True,
    ),
    driven: SimulationOptions = _SIMULATION,
    hold_out: tuple[str, ...] = option(
        "Run kept out of the fit, to check the result; may be repeated (default: the doublets).",
        metavar="RUN",
        multiple=True,
    ),
    only: tuple[str, ...] = option("Test only these effects.", EFFECTS, default=()),
    without: tuple[str, ...] = option("Do not test these effects.", EFFECTS, default=()),
    time_limit: float | None = option(
        "Stop after this time and report the findings so far.", click.FloatRange(1), "S"
    ),
    reading: Reading = READING,
    out: str = REPORT,
    as_json: bool = option("Print diagnosis.json on stdout; tables go to stderr.", flag="--json"),
    full: bool = option(
        "Show all effects that could still hide; with --simulation, the diagnosis of the RUNs too."
    ),
) -> None:
    """Find physical effects in the recorded RUNs that the model leaves out: where, size and evidence.

    RUN is a .BIN, a .tlog, a file of another system (.csv, .mcap, ...), log.BIN+log.tlog, or a session's
    folder. Runs at two amplitudes and two speeds separate most effects; `rover-sweep plan` shows which.
    --simulation compares a simulation with the recordings too, and reports the differences; --simulator
    drives one like the RUNs for that. Ctrl-C reports the findings so far and exits with code 130.
    """
    from rover_sweep.api.diagnosis_input import candidates_left, material, nominal_of, time_limit_of
    from rover_sweep.api.read import load_steered
    from rover_sweep.cli.driving.shown_results import show_diagnosed
    from rover_sweep.data.vehicle_file import load as load_vehicle
    from rover_sweep.diagnosis.result import DiagnosisSettings

    simulator, seed = driven.simulator, driven.seed
    if simulation and (model or simulator):
        other = "--model" if model else "--simulator"
        raise UsageError(f"{other} and --simulation are alternatives; give only one of them")
    if driven.variant and not simulator:
        raise UsageError(f"--variant {driven.variant} needs --simulator")
    limit = time_limit_of(time_limit)
    name, values = nominal_of(Path(model), baseline) if model else (baseline, {})
    chosen, left_out = candidates_left(only, without, None if simulation else name)
    settings = DiagnosisSettings(name, chosen, left_out, limit, seed, values)
    check_report_folder(Path(out), ("diagnosis.json",), ("diagnosis.html", "variant.toml"))
    path = Path(vehicle_path(vehicle_file, runs))
    vehicle = load_vehicle(path)
    sources = (*runs, *hold_out, *simulation)

    def read(some: tuple[str, ...]) -> tuple[Recording, ...]:
        return load_steered(some, vehicle, reading, [s for s in sources if s not in some]) if some else ()

    def drive(found: Diagnosis) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
        from rover_sweep.redrive.recorded_course import simulated_rover
        from rover_sweep.twin.loop import laws_of, recorded_drives, simulated_drives, with_measured

        assert simulator is not None and found.model is not None
        rover = simulated_rover(driven.variant or "nominal", None)
        rover = rover if driven.variant else with_measured(rover, vehicle)[0]
        _say(f"driving the simulated rover ({simulator}) like the recordings")
        drives, folder = recorded_drives(sources, reading.columns), Path(out) / "simulated"
        paths = simulated_drives(drives, rover, folder, simulator, driven.binary, seed, _say)
        again = replace(reading, columns=None)
        return load_steered(paths, vehicle, again, sources), laws_of(rover, found.model)

    given = material(read(runs), read(hold_out), read(simulation))
    show_diagnosed(given, (vehicle, path), settings, Path(out), as_json, drive if simulator else None, full)


def _say(words: str) -> None:
    narration().print(words, soft_wrap=True)


class _Commands(click.Group):
    """`twin serve DIR` is a command of its own; every other call is `twin RUN...`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if not args or args[0] not in self.commands:
            args = ["correct", *args]
        return super().parse_args(ctx, args)


@click.group(cls=_Commands)
def twin() -> None:
    """Correct a simulation until it agrees with recordings, or serve it."""


@dataclass(frozen=True)
class TwinCall:
    """What the user asked for."""

    runs: tuple[str, ...] = argument("RUN...", nargs=-1, required=True)
    hold_out: tuple[str, ...] = option(
        "Run that only checks the result; may be repeated (default: the doublets).",
        metavar="RUN",
        multiple=True,
    )
    vehicle: str | None = VEHICLE
    simulation: SimulationOptions = gathered(
        SimulationOptions,
        variant=option(
            "Simulated rover to begin with, as in redrive. A named one gets the numbers of the vehicle file.",
            metavar="NAME|FILE",
            default="nominal",
        ),
        simulator=option(
            "embedded or ardurover: drive the corrected rover once more on it.",
            click.Choice(SIMULATORS),
            default="plant",
        ),
        seed=RANDOM,
    )
    reading: Reading = READING
    out: str = option(
        "Folder of the report and of the variant file; created if missing.", FOLDER, required=True
    )
    as_json: bool = option("Print twin.json on stdout; tables go to stderr.", flag="--json")


TWIN = gathered(TwinCall)


@twin.command()
@options
def correct(call: TwinCall = TWIN) -> None:
    """Compare a simulated rover with RUNs, correct it, and drive it again until it agrees.

    The simulated rover repeats the steering and speed of each RUN (.BIN, .tlog). What differs is corrected in
    a variant file, DIR/variant.toml: numbers and effects, each with its reason. Held-out runs are only
    compared. Ctrl-C ends with the corrections so far. `rover-sweep twin serve DIR` drives the result.
    """
    from rover_sweep.api.diagnosis_input import material
    from rover_sweep.api.read import load_steered
    from rover_sweep.cli.driving.shown_results import made_now
    from rover_sweep.cli.views.asking import Interruption
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.redrive.recorded_course import refuse_instant, simulated_rover
    from rover_sweep.report.comparison_report import twin_report, write_twin
    from rover_sweep.report.on_terminal import WIDTH, on_terminal
    from rover_sweep.twin.loop import with_measured

    measured: tuple[Correction, ...]
    out = Path(call.out)
    check_writable(out)
    path = Path(vehicle_path(call.vehicle, call.runs))
    console, shown = narration(), results(call.as_json)
    vehicle = load(path)
    variant, simulator = call.simulation.variant, call.simulation.simulator or "plant"
    rover, measured = simulated_rover(variant, None), ()
    if simulator != "plant":
        refuse_instant(rover, simulator)
    if not variant.endswith(".toml"):  # a named one gets the measured numbers of the vehicle file
        try:
            rover, measured = with_measured(rover, vehicle)
        except ValueError as error:  # numbers that are valid one by one but not together
            raise UsageError(f"{path}: {error}") from error
    runs = load_steered(call.runs, vehicle, call.reading, call.hold_out)
    held = load_steered(call.hold_out, vehicle, call.reading, call.runs) if call.hold_out else ()
    given = material(runs, held)
    print_warnings(console, (*given.runs, *given.held_out))
    words = "stopping with the corrections so far; press Ctrl-C again to quit without a report"
    with Interruption(lambda: console.print(words, style="yellow")) as asked:
        found = _twin(call, vehicle, rover, measured, given, asked.to_stop)
    origin = made_now((vehicle, path), given.held_out)
    page = write_twin(found, out, origin)
    shown.print(on_terminal(twin_report(found, origin)), width=min(shown.width, WIDTH))
    shown.print(f"\nreport: {page}", soft_wrap=True)
    shown.print(f"corrected rover: {out / 'variant.toml'}", soft_wrap=True)
    say_next(f"rover-sweep dry-run --variant {out / 'variant.toml'}", f"rover-sweep twin serve {out}")
    if call.as_json:
        echo_json((out / "twin.json").read_text(encoding="utf-8"))
    if asked.to_stop():
        raise click.Abort


def _twin(
    call: TwinCall,
    vehicle: Vehicle,
    rover: PlantParameters,
    measured: tuple[Correction, ...],
    given: Material,
    stop: Callable[[], bool],
) -> Twin:
    """The recordings diagnosed, and the rover corrected by them; with the text of its variant file."""
    from rover_sweep.api.diagnose import compared
    from rover_sweep.api.read import load_steered
    from rover_sweep.cli.driving.shown_results import diagnosis_of
    from rover_sweep.comparison.common_model import FittedSide
    from rover_sweep.comparison.compare import Compared
    from rover_sweep.diagnosis.result import DiagnosisSettings
    from rover_sweep.twin.loop import (
        measured_differences,
        recorded_drives,
        simulated_drives,
        twin_of,
        variant_with_reasons,
        with_last_drive,
    )

    count, sources = 0, (*call.runs, *call.hold_out)
    drives = recorded_drives(sources, call.reading.columns)
    simulator, seed = call.simulation.simulator or "plant", call.simulation.seed
    fitted: dict[tuple[str, ...], FittedSide] = {}
    found = diagnosis_of(given, vehicle, DiagnosisSettings(seed=seed), stop)
    if found.model is None:
        raise DataRefused(f"the recordings were refused: {found.sentence}")

    _say(f"recordings: {found.sentence}")

    def drive(rover: PlantParameters, simulator: str = "plant") -> Sequence[Recording]:
        nonlocal count
        count += 1
        folder = Path(call.out) / "simulated" / f"drive{count}"
        binary = call.simulation.binary
        paths = simulated_drives(drives, rover, folder, simulator, binary, seed + 10 * count, _say)
        return load_steered(paths, vehicle, replace(call.reading, columns=None), sources)

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
            seed,
            fitted=fitted,
            measured=known,
            changed=changed,
        )

    twin, rover = twin_of(rover, measured, found.model, drive, compare, _say, stop)
    if simulator != "plant" and not stop():
        _say(f"driving the corrected rover on {simulator}")
        twin = with_last_drive(twin, rover, found.model, lambda r: drive(r, simulator), compare, simulator)
    text = variant_with_reasons(rover, twin.corrections, call.simulation.variant)
    remarks = tuple(r for r in found.remarks if "held out" in r)
    return replace(twin, variant=text, remarks=(*twin.remarks, *remarks))


@twin.command()
@options
def serve(
    directory: str = argument("DIR", type=click.Path(exists=True)),
    ardurover: str | None = ARDUROVER,
    physics: bool = option("Only the physics; start the firmware yourself."),
    instance: int = option("Moves the ports by 10.", click.IntRange(min=0), default=0),
    seed: int = RANDOM,
) -> None:
    """Serve the corrected rover of DIR (or a variant file) to the official firmware, on this machine only.

    Starts ArduRover's SITL with the twin as its physics and prints where to connect a ground station; nothing
    arms or moves by itself. --physics serves only the JSON interface. Ctrl-C ends it.
    """
    from rover_sweep.cli.driving.simulated import serve_twin

    serve_twin(Path(directory), Path(ardurover) if ardurover else None, physics, instance, seed)
