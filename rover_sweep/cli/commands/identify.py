"""`rover-sweep identify`: identify models from recorded runs and write a report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.options import (
    OUTPUTS,
    BandType,
    ChoicesType,
    NumberRange,
    NumbersType,
    check_report_folder,
    filter_overrides,
    output_options,
    reading_options,
    vehicle_path,
)
from rover_sweep.errors import DataRefused, UsageError

if TYPE_CHECKING:
    from rover_sweep.identification.identify_speed import SpeedResult

MODELS = ("bicycle", "roll-yaw", "lumped")
REPLACED = ("report.html", "speed.html", "pictures/*", "models/*")  # by a new report


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
@click.option(
    "--units",
    type=click.Choice(["SI", "paper"], case_sensitive=False),
    default="SI",
    show_default=True,
    help="Accelerations in m/s^2 or, as in the paper, in ft/s^2; files for programs stay in SI.",
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
    units: str,
) -> None:
    """Identify bicycle, roll-yaw and lumped models from recorded RUNs and write a report.

    RUN is a .BIN, a .tlog, a .csv (with --columns), both logs of one drive as log.BIN+log.tlog, or a
    session's folder. Several runs are fitted together. Doublets among them are used to verify the models,
    unless --verify names other runs. Throttle sweeps are recognised, and identified into
    DIR/speed.html and DIR/speed.json.
    """
    from rover_sweep.api.identify import parameter_names
    from rover_sweep.api.read import Reading, fitted_and_verified, load_steered, load_structures
    from rover_sweep.cli.driving.shown_results import add_steering, show_identified
    from rover_sweep.data.vehicle_file import load as load_vehicle
    from rover_sweep.identification.grouping import Settings

    own = load_structures(structures)
    check_report_folder(Path(out), ("identification.json", "speed.json"), REPLACED)
    speed, runs = _of_throttle(runs, Path(out), as_json)
    if not runs:
        return
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
    show_identified(
        sweeps, checks, (vehicle, path), settings, Path(out), as_json, full, structures=own, units=units
    )
    add_steering(speed, Path(out))


def _of_throttle(
    runs: tuple[str, ...], out: Path, as_json: bool
) -> tuple[SpeedResult | None, tuple[str, ...]]:
    """Identify the speed from the throttle sweeps among the runs; the runs that are not of these alone."""
    from rover_sweep.api.speed import throttle_sweeps
    from rover_sweep.cli.driving.shown_results import show_speed

    swept = throttle_sweeps(runs)
    if not swept:
        return None, runs
    steered = tuple(run for run in runs if not throttle_sweeps((run,)) or _is_steered(run))
    return show_speed(swept, out, as_json, alone=not steered), steered


def _is_steered(source: str) -> bool:
    """Whether a recording holds runs of the steering too."""
    from rover_sweep.api.read import load_runs

    try:
        return bool(load_runs((source,), None, None))
    except DataRefused:
        return False


def _swept(wmin: float | None, wmax: float | None) -> tuple[float, float] | None:
    if wmin is None and wmax is None:
        return None
    if wmin is None or wmax is None or not wmin < wmax:
        raise UsageError(f"give both --wmin and --wmax with wmin < wmax, got {wmin} and {wmax} rad/s")
    return wmin, wmax
