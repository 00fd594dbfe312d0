"""`rover-sweep diagnose`: what the model leaves out of the recorded runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.types.folders import check_writable
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
    help="The model that something may be left out of (default: roll-yaw).",
)
@click.option(
    "--model",
    "model_file",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="An identified model as the baseline: the identification.json of a report.",
)
@click.option(
    "--simulation",
    "simulated",
    multiple=True,
    metavar="RUN",
    help="A recording of a simulation that was driven as the RUNs; may be repeated.",
)
@click.option(
    "--hold-out",
    "held_out",
    multiple=True,
    metavar="RUN",
    help="A run that fit and choice must not see; may be repeated (else: doublets).",
)
@click.option("--only", type=EFFECTS, default=(), help="The only candidates to try.")
@click.option("--without", type=EFFECTS, default=(), help="Candidates to leave out.")
@click.option(
    "--time-limit",
    type=click.FloatRange(1),
    metavar="S",
    help="End after this time with what was found until then.",
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Of the bootstrap.")
@reading_options
@click.option(
    "--out",
    required=True,
    type=click.Path(file_okay=False),
    metavar="DIR",
    help="Folder of the report; made if it is not there.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="diagnosis.json on stdout; the tables then go to stderr."
)
def diagnose(
    runs: tuple[str, ...],
    vehicle_file: str | None,
    baseline: Baseline | None,
    model_file: str | None,
    simulated: tuple[str, ...],
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
    """Say what the model leaves out of the recorded RUNs: where, what, how much, and on what evidence.

    RUN is a .BIN, a .tlog, a .csv (with --columns), log.BIN+log.tlog, or a session's folder. Two
    amplitudes and two speeds tell most effects apart; `rover-sweep plan` says which. Ctrl-C ends with what
    was found until then, and with exit code 130.
    """
    from rover_sweep.api.diagnosis_input import material
    from rover_sweep.api.read import Reading, load
    from rover_sweep.cli.driving.show_diagnosed import show_diagnosed
    from rover_sweep.data.vehicle_file import load as load_vehicle

    settings = _settings(baseline, model_file, simulated, only, without, time_limit, seed)
    check_writable(Path(out))
    path = Path(vehicle_path(vehicle_file, runs))
    vehicle = load_vehicle(path)
    reading = Reading(columns, filter_overrides(gyro_filter, accel_filter), system)
    sources = (*runs, *held_out, *simulated)

    def read(some: tuple[str, ...]) -> tuple[Recording, ...]:
        return load(some, vehicle, reading, [s for s in sources if s not in some]) if some else ()

    given = material(read(runs), read(held_out), read(simulated))
    show_diagnosed(given, (vehicle, path), settings, Path(out), as_json)


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
        raise UsageError("--model and --simulation are two simulations; give one of them")
    limit = time_limit_of(time_limit)
    name, values = nominal_of(Path(model_file), baseline) if model_file else (baseline or "roll-yaw", {})
    chosen, left_out = candidates_left(only, without, None if simulated else name)
    return DiagnosisSettings(name, chosen, left_out, limit, seed, values)
