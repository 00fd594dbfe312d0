"""`rover-sweep diagnose`: find effects in the recorded runs that the model leaves out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.types.folders import check_report_folder
from rover_sweep.cli.types.options import EFFECTS, filter_overrides, reading_options, vehicle_path
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.data.recording import Recording
    from rover_sweep.diagnosis.settings import Baseline, DiagnosisSettings

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
    from rover_sweep.cli.driving.show_compared import SimulatorCall, simulator_of
    from rover_sweep.cli.driving.show_diagnosed import show_diagnosed
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
    from rover_sweep.diagnosis.settings import DiagnosisSettings

    if model_file and simulated:
        raise UsageError("--model and --simulation are alternatives; give only one of them")
    limit = time_limit_of(time_limit)
    name, values = nominal_of(Path(model_file), baseline) if model_file else (baseline, {})
    chosen, left_out = candidates_left(only, without, None if simulated else name)
    return DiagnosisSettings(name, chosen, left_out, limit, seed, values)
