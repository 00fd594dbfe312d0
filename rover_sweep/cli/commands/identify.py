"""`rover-sweep identify`: recorded runs in, identified models and a report out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.types.folders import check_writable
from rover_sweep.cli.types.options import (
    OUTPUTS,
    BandType,
    ChoicesType,
    NumberRange,
    NumbersType,
    filter_overrides,
    output_options,
    reading_options,
    vehicle_path,
)
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    pass

MODELS = ("bicycle", "roll-yaw", "lumped")


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
    "--verify",
    "verify_runs",
    multiple=True,
    metavar="RUN",
    help="A run that the fit must not see, such as a doublet; may be repeated.",
)
@click.option("--models", type=ChoicesType(MODELS), default=",".join(MODELS), show_default=True)
@click.option(
    "--fit",
    "fitted",
    type=ChoicesType(OUTPUTS),
    default="r,ay,p",
    show_default=True,
    help="Responses that the fit uses; all four are reported.",
)
@click.option(
    "--structure",
    "structures",
    type=click.Path(dir_okay=False),
    multiple=True,
    metavar="FILE",
    help="A structure of your own (TOML), fitted beside the models; may be repeated.",
)
@click.option(
    "--condition-on",
    "condition_on",
    multiple=True,
    metavar="CHANNEL",
    help="What else moves the rover, e.g. throttle: taken out of the responses.",
)
@click.option("--untied", is_flag=True, help="Free Cf and Cr each, in place of one C for both axles.")
@click.option("--no-reduction", is_flag=True, help="Keep every free parameter, told by the data or not.")
@click.option(
    "--keep",
    multiple=True,
    metavar="NAME",
    help="A parameter that the structure reduction leaves free, e.g. Ixx or Y_phi.",
)
@click.option(
    "--band",
    "bands",
    type=BandType(),
    multiple=True,
    help="Usable band of a response in place of the one found from its coherence.",
)
@click.option("--wmin", type=NumberRange(0, min_open=True), metavar="RAD/S", help="Lowest swept frequency.")
@click.option("--wmax", type=NumberRange(0, min_open=True), metavar="RAD/S", help="Highest swept frequency.")
@click.option("--windows", type=NumbersType(), metavar="S,S,...", help="Window lengths, s.")
@click.option(
    "--bootstrap",
    type=click.IntRange(min=0),
    default=200,
    show_default=True,
    metavar="N",
    help="Replicates for the 90 % intervals of the parameters; 0: no intervals.",
)
@reading_options
@click.option(
    "--out",
    required=True,
    type=click.Path(file_okay=False),
    metavar="DIR",
    help="Folder of the report; made if it is not there.",
)
@output_options
def identify(
    runs: tuple[str, ...],
    vehicle_file: str | None,
    verify_runs: tuple[str, ...],
    models: tuple[str, ...],
    fitted: tuple[str, ...],
    untied: bool,
    no_reduction: bool,
    keep: tuple[str, ...],
    bands: tuple[Any, ...],
    wmin: float | None,
    wmax: float | None,
    windows: tuple[float, ...] | None,
    columns: str | None,
    gyro_filter: float | None,
    accel_filter: float | None,
    system: int | None,
    out: str,
    as_json: bool,
    verbose: bool,
    structures: tuple[str, ...],
    condition_on: tuple[str, ...],
    bootstrap: int,
) -> None:
    """Identify bicycle, roll-yaw and lumped models from recorded RUNs and write a report.

    RUN is a .BIN, a .tlog, a .csv (with --columns), a pair of both logs of one drive as
    log.BIN+log.tlog, or the folder of a session. Several runs are used together. Doublets among
    them verify the models unless --verify names runs for that.
    """
    from rover_sweep.api.identify_settings import parameter_names
    from rover_sweep.api.read import Reading, load
    from rover_sweep.api.run_roles import divided, refuse_overlap
    from rover_sweep.api.structure_files import load_structures
    from rover_sweep.cli.driving.show_identified import show_identified
    from rover_sweep.data.vehicle_file import load as load_vehicle
    from rover_sweep.identification.grouping import Settings

    own = load_structures(structures)
    check_writable(Path(out))
    path = Path(vehicle_path(vehicle_file, runs))
    vehicle = load_vehicle(path)
    reading = Reading(columns, filter_overrides(gyro_filter, accel_filter), system)
    sweeps, doublets = divided(load(runs, vehicle, reading, verify_runs))
    checks = load(verify_runs, vehicle, reading, runs) if verify_runs else doublets
    refuse_overlap(sweeps, checks)
    settings = Settings(
        models,
        fitted,
        not untied,
        _swept(wmin, wmax),
        dict(bands),
        windows,
        reduction=not no_reduction,
        keep=parameter_names(keep),
        condition_on=tuple(dict.fromkeys(condition_on)),
        bootstrap=bootstrap,
    )
    show_identified(sweeps, checks, (vehicle, path), settings, Path(out), as_json, verbose, structures=own)


def _swept(wmin: float | None, wmax: float | None) -> tuple[float, float] | None:
    if wmin is None and wmax is None:
        return None
    if wmin is None or wmax is None or not wmin < wmax:
        raise UsageError(f"give both --wmin and --wmax with wmin < wmax, got {wmin} and {wmax} rad/s")
    return wmin, wmax
