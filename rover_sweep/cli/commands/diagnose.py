"""`rover-sweep diagnose`: find effects in the recorded runs that the model leaves out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.options import (
    EFFECTS,
    check_report_folder,
    filter_overrides,
    reading_options,
    vehicle_path,
)
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.data.recording import Recording
    from rover_sweep.diagnosis.result import Baseline, DiagnosisSettings

BASELINES = ("roll-yaw", "bicycle", "lumped", "kinematic")


@click.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@click.option(
    "--vehicle",
    "vehicle_file",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="Vehicle file (default: the session's, or rover.toml here).",
)
@click.option(
    "--baseline",
    type=click.Choice(BASELINES),
    help="Baseline model to test (default: roll-yaw, or less if the runs do not determine roll or tyres).",
)
@click.option(
    "--model",
    "model_file",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="Test an identified model: the identification.json of a report.",
)
@click.option(
    "--simulation",
    "simulated",
    multiple=True,
    metavar="RUN|SIMULATOR",
    help="Recording of a simulation with the steering of a RUN, to compare; may be repeated. Or plant, "
    "embedded or ardurover, which is then driven like the RUNs.",
)
@click.option(
    "--variant",
    metavar="NAME|FILE",
    help="Simulated rover of --simulation plant, embedded or ardurover (default: nominal, with the vehicle "
    "file's numbers).",
)
@click.option(
    "--ardurover",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="The ArduRover SITL program of --simulation ardurover (else $ROVER_SWEEP_ARDUROVER, else the PATH).",
)
@click.option(
    "--hold-out",
    "held_out",
    multiple=True,
    metavar="RUN",
    help="Run kept out of the fit, to check the result; may be repeated (default: the doublets).",
)
@click.option("--only", type=EFFECTS, default=(), help="Test only these effects.")
@click.option("--without", type=EFFECTS, default=(), help="Do not test these effects.")
@click.option(
    "--time-limit",
    type=click.FloatRange(1),
    metavar="S",
    help="Stop after this time and report the findings so far.",
)
@click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Random seed of the bootstrap."
)
@reading_options
@click.option(
    "--out",
    required=True,
    type=click.Path(file_okay=False),
    metavar="DIR",
    help="Folder of the report; created if missing.",
)
@click.option("--json", "as_json", is_flag=True, help="Print diagnosis.json on stdout; tables go to stderr.")
def diagnose(
    runs: tuple[str, ...],
    vehicle_file: str | None,
    baseline: Baseline | None,
    model_file: str | None,
    simulated: tuple[str, ...],
    variant: str | None,
    ardurover: str | None,
    held_out: tuple[str, ...],
    only: tuple[str, ...],
    without: tuple[str, ...],
    time_limit: float | None,
    seed: int,
    columns: str | None,
    gyro_filter: float | None,
    accel_filter: float | None,
    system: int | None,
    out: str,
    as_json: bool,
) -> None:
    """Find physical effects in the recorded RUNs that the model leaves out: where, size and evidence.

    RUN is a .BIN, a .tlog, a .csv (with --columns), log.BIN+log.tlog, or a session's folder. Runs at two
    amplitudes and two speeds separate most effects; `rover-sweep plan` shows which. --simulation compares a
    simulation with the recordings too, and says what it has otherwise. Ctrl-C reports the findings so far and
    exits with code 130.
    """
    from rover_sweep.api.diagnosis_input import material
    from rover_sweep.api.read import Reading, load_steered
    from rover_sweep.cli.driving.shown_results import SimulatorCall, show_diagnosed, simulator_of
    from rover_sweep.data.vehicle_file import load as load_vehicle

    simulator = simulator_of(simulated, variant)
    simulated = () if simulator else simulated
    settings = _settings(baseline, model_file, simulated, only, without, time_limit, seed)
    check_report_folder(Path(out), ("diagnosis.json",), ("diagnosis.html", "variant.toml"))
    path = Path(vehicle_path(vehicle_file, runs))
    vehicle = load_vehicle(path)
    reading = Reading(columns, filter_overrides(gyro_filter, accel_filter), system)
    sources = (*runs, *held_out, *simulated)

    def read(some: tuple[str, ...]) -> tuple[Recording, ...]:
        return load_steered(some, vehicle, reading, [s for s in sources if s not in some]) if some else ()

    given = material(read(runs), read(held_out), read(simulated))
    binary = Path(ardurover) if ardurover else None
    drive = (
        SimulatorCall((*runs, *held_out), simulator, variant, binary, Path(out), seed, reading)
        if simulator
        else None
    )
    show_diagnosed(given, (vehicle, path), settings, Path(out), as_json, drive)


def _settings(
    baseline: Baseline | None,
    model_file: str | None,
    simulated: tuple[str, ...],
    only: tuple[str, ...],
    without: tuple[str, ...],
    time_limit: float | None,
    seed: int,
) -> DiagnosisSettings:
    from rover_sweep.api.diagnosis_input import candidates_left, nominal_of, time_limit_of
    from rover_sweep.diagnosis.result import DiagnosisSettings

    if model_file and simulated:
        raise UsageError("--model and --simulation are alternatives; give only one of them")
    limit = time_limit_of(time_limit)
    name, values = nominal_of(Path(model_file), baseline) if model_file else (baseline, {})
    chosen, left_out = candidates_left(only, without, None if simulated else name)
    return DiagnosisSettings(name, chosen, left_out, limit, seed, values)


# `rover-sweep twin`: correct a simulation until it agrees with recordings; `twin serve`: drive on it.


SIMULATORS = ("plant", "embedded", "ardurover")


class _Commands(click.Group):
    """`twin serve DIR` is a command of its own; every other call is `twin RUN...`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if not args or args[0] not in self.commands:
            args = ["correct", *args]
        return super().parse_args(ctx, args)


@click.group(cls=_Commands)
def twin() -> None:
    """Correct a simulation until it agrees with recordings, or serve it."""


@twin.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@click.option(
    "--variant",
    default="nominal",
    show_default=True,
    metavar="NAME|FILE",
    help="Simulated rover to begin with, as in redrive. A named one gets the numbers of the vehicle file.",
)
@click.option(
    "--hold-out",
    "held_out",
    multiple=True,
    metavar="RUN",
    help="Run that only checks the result; may be repeated (default: the doublets).",
)
@click.option(
    "--vehicle",
    "vehicles",
    multiple=True,
    metavar="FILE|SIMULATOR",
    help="Vehicle file (default: the session's, or rover.toml here); or embedded or ardurover, which then "
    "drives the corrected rover once more. May be given twice.",
)
@click.option(
    "--ardurover",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="The ArduRover SITL program (else $ROVER_SWEEP_ARDUROVER, else the PATH).",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Random seed.")
@reading_options
@click.option(
    "--out",
    required=True,
    type=click.Path(file_okay=False),
    metavar="DIR",
    help="Folder of the report and of the variant file; created if missing.",
)
@click.option("--json", "as_json", is_flag=True, help="Print twin.json on stdout; tables go to stderr.")
def correct(
    runs: tuple[str, ...],
    variant: str,
    held_out: tuple[str, ...],
    vehicles: tuple[str, ...],
    ardurover: str | None,
    seed: int,
    columns: str | None,
    gyro_filter: float | None,
    accel_filter: float | None,
    system: int | None,
    out: str,
    as_json: bool,
) -> None:
    """Compare a simulated rover with RUNs, correct it, and drive it again until it agrees.

    The simulated rover repeats the steering and speed of each RUN (.BIN, .tlog). What differs is corrected in
    a variant file, DIR/variant.toml: numbers and effects, each with its reason. Held-out runs are only
    compared. Ctrl-C ends with the corrections so far. `rover-sweep twin serve DIR` drives the result.
    """
    from rover_sweep.api.read import Reading
    from rover_sweep.cli.driving.shown_results import TwinCall, show_twin
    from rover_sweep.cli.options import check_writable, filter_overrides, vehicle_path

    simulators = [v for v in vehicles if v in SIMULATORS]
    files = [v for v in vehicles if v not in SIMULATORS]
    if len(simulators) > 1 or len(files) > 1:
        raise UsageError(
            f"--vehicle {', '.join(vehicles)}: give at most one vehicle file, and at most one of "
            f"{', '.join(SIMULATORS)}"
        )
    check_writable(Path(out))
    show_twin(
        TwinCall(
            runs,
            held_out,
            Path(vehicle_path(files[0] if files else None, runs)),
            variant,
            simulators[0] if simulators else "plant",
            Path(ardurover) if ardurover else None,
            seed,
            Reading(columns, filter_overrides(gyro_filter, accel_filter), system),
            Path(out),
        ),
        as_json,
    )


@twin.command()
@click.argument("directory", metavar="DIR", type=click.Path(exists=True))
@click.option(
    "--ardurover",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="The ArduRover SITL program (else $ROVER_SWEEP_ARDUROVER, else the PATH).",
)
@click.option("--physics", is_flag=True, help="Only the physics; start the firmware yourself.")
@click.option(
    "--instance", type=click.IntRange(min=0), default=0, show_default=True, help="Moves the ports by 10."
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Random seed.")
def serve(directory: str, ardurover: str | None, physics: bool, instance: int, seed: int) -> None:
    """Serve the corrected rover of DIR (or a variant file) to the official firmware, on this machine only.

    Starts ArduRover's SITL with the twin as its physics and prints where to connect a ground station; nothing
    arms or moves by itself. --physics serves only the JSON interface. Ctrl-C ends it.
    """
    from rover_sweep.cli.driving.job import serve_twin

    serve_twin(Path(directory), Path(ardurover) if ardurover else None, physics, instance, seed)
