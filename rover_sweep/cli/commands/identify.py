"""`rover-sweep identify`: identify models from recorded runs and write a report."""

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
    help="Run for verification only, such as a doublet; may be repeated.",
)
@click.option(
    "--models",
    type=ChoicesType(MODELS),
    default=",".join(MODELS),
    show_default=True,
    help="Models to identify.",
)
@click.option(
    "--fit",
    "fitted",
    type=ChoicesType(OUTPUTS),
    default="r,ay,p",
    show_default=True,
    help="Responses used in the fit; all four are reported.",
)
@click.option(
    "--structure",
    "structures",
    type=click.Path(dir_okay=False),
    multiple=True,
    metavar="FILE",
    help="Additional model structure of your own (TOML); may be repeated.",
)
@click.option(
    "--condition-on",
    "condition_on",
    multiple=True,
    metavar="CHANNEL",
    help="Second input whose effect is removed from the responses, e.g. throttle.",
)
@click.option("--untied", is_flag=True, help="Fit Cf and Cr separately instead of one C for both axles.")
@click.option(
    "--no-reduction", is_flag=True, help="Keep all parameters, even those the data cannot determine."
)
@click.option(
    "--keep",
    multiple=True,
    metavar="NAME",
    help="Parameter that the structure reduction keeps free, e.g. Ixx or Y_phi.",
)
@click.option(
    "--band",
    "bands",
    type=BandType(),
    multiple=True,
    help="Frequency band used of a response, rad/s. [default: from its coherence]",
)
@click.option("--wmin", type=NumberRange(0, min_open=True), metavar="RAD/S", help="Lowest swept frequency.")
@click.option("--wmax", type=NumberRange(0, min_open=True), metavar="RAD/S", help="Highest swept frequency.")
@click.option("--windows", type=NumbersType(), metavar="S,S,...", help="Window lengths of the spectra, s.")
@click.option(
    "--bootstrap",
    type=click.IntRange(min=0),
    default=200,
    show_default=True,
    metavar="N",
    help="Number of replicates for the 90 % intervals of the parameters; 0: no intervals.",
)
@reading_options
@click.option(
    "--out",
    required=True,
    type=click.Path(file_okay=False),
    metavar="DIR",
    help="Folder of the report; created if missing.",
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
    full: bool,
    structures: tuple[str, ...],
    condition_on: tuple[str, ...],
    bootstrap: int,
) -> None:
    """Identify bicycle, roll-yaw and lumped models from recorded RUNs and write a report.

    RUN is a .BIN, a .tlog, a .csv (with --columns), both logs of one drive as log.BIN+log.tlog, or a
    session's folder. Several runs are fitted together. Doublets among them are used to verify the models,
    unless --verify names other runs.
    """
    from rover_sweep.api.identify_settings import parameter_names
    from rover_sweep.api.read import Reading, load_steered
    from rover_sweep.api.run_roles import fitted_and_verified
    from rover_sweep.api.structure_files import load_structures
    from rover_sweep.cli.driving.show_identified import show_identified
    from rover_sweep.data.vehicle_file import load as load_vehicle
    from rover_sweep.identification.grouping import Settings

    own = load_structures(structures)
    check_writable(Path(out))
    path = Path(vehicle_path(vehicle_file, runs))
    vehicle = load_vehicle(path)
    reading = Reading(columns, filter_overrides(gyro_filter, accel_filter), system)
    given = load_steered(runs, vehicle, reading, verify_runs)
    verify = load_steered(verify_runs, vehicle, reading, runs) if verify_runs else ()
    sweeps, checks = fitted_and_verified(given, verify)
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
    show_identified(sweeps, checks, (vehicle, path), settings, Path(out), as_json, full, structures=own)


def _swept(wmin: float | None, wmax: float | None) -> tuple[float, float] | None:
    if wmin is None and wmax is None:
        return None
    if wmin is None or wmax is None or not wmin < wmax:
        raise UsageError(f"give both --wmin and --wmax with wmin < wmax, got {wmin} and {wmax} rad/s")
    return wmin, wmax
