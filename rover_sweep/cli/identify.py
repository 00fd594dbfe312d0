"""`rover-sweep identify`: recorded runs in, identified models and a report out."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.folders import check_writable
from rover_sweep.cli.options import (
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
    from collections.abc import Callable, Sequence

    from rich.console import RenderableType

    from rover_sweep.identify.grouping import Settings
    from rover_sweep.identify.identification import Identification
    from rover_sweep.identify.recording import Recording
    from rover_sweep.identify.structure import ModelStructure
    from rover_sweep.vehicle_file import Vehicle

MODELS = ("bicycle", "roll-yaw", "lumped")


@click.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@click.option("--vehicle", "vehicle_file", type=click.Path(dir_okay=False), metavar="FILE",
              help="Vehicle file (default: the session's, or rover.toml here).")  # fmt: skip
@click.option("--verify", "verify_runs", multiple=True, metavar="RUN",
              help="A run that the fit must not see, such as a doublet; may be repeated.")  # fmt: skip
@click.option("--models", type=ChoicesType(MODELS), default=",".join(MODELS), show_default=True)
@click.option("--fit", "fitted", type=ChoicesType(OUTPUTS), default="r,ay,p", show_default=True,
              help="Responses that the fit uses; all four are reported.")  # fmt: skip
@click.option("--structure", "structures", type=click.Path(dir_okay=False), multiple=True, metavar="FILE",
              help="A structure of your own (TOML), fitted beside the models; may be repeated.")  # fmt: skip
@click.option("--condition-on", "condition_on", multiple=True, metavar="CHANNEL",
              help="What else moves the rover, e.g. throttle: taken out of the responses.")  # fmt: skip
@click.option("--untied", is_flag=True, help="Free Cf and Cr each, in place of one C for both axles.")
@click.option("--no-reduction", is_flag=True, help="Keep every free parameter, told by the data or not.")
@click.option("--keep", multiple=True, metavar="NAME",
              help="A parameter that the structure reduction leaves free, e.g. Ixx or Y_phi.")  # fmt: skip
@click.option("--band", "bands", type=BandType(), multiple=True,
              help="Usable band of a response in place of the one found from its coherence.")  # fmt: skip
@click.option("--wmin", type=NumberRange(0, min_open=True), metavar="RAD/S", help="Lowest swept frequency.")
@click.option("--wmax", type=NumberRange(0, min_open=True), metavar="RAD/S", help="Highest swept frequency.")
@click.option("--windows", type=NumbersType(), metavar="S,S,...", help="Window lengths, s.")
@click.option("--bootstrap", type=click.IntRange(min=0), default=200, show_default=True, metavar="N",
              help="Replicates for the 90 % intervals of the parameters; 0: no intervals.")  # fmt: skip
@reading_options
@click.option("--out", required=True, type=click.Path(file_okay=False), metavar="DIR",
              help="Folder of the report; made if it is not there.")  # fmt: skip
@output_options
def identify(
    runs: tuple[str, ...], vehicle_file: str | None, verify_runs: tuple[str, ...], models: tuple[str, ...],
    fitted: tuple[str, ...], untied: bool, no_reduction: bool, keep: tuple[str, ...], bands: tuple[Any, ...],
    wmin: float | None, wmax: float | None, windows: tuple[float, ...] | None, columns: str | None,
    gyro_filter: float | None, accel_filter: float | None, system: int | None, out: str, as_json: bool,
    verbose: bool, structures: tuple[str, ...], condition_on: tuple[str, ...], bootstrap: int,
) -> None:  # fmt: skip
    """Identify bicycle, roll-yaw and lumped models from recorded RUNs and write a report.

    RUN is a .BIN, a .tlog, a .csv (with --columns), a pair of both logs of one drive as
    log.BIN+log.tlog, or the folder of a session. Several runs are used together. Doublets among
    them verify the models unless --verify names runs for that.
    """
    from rover_sweep.identify.grouping import Settings
    from rover_sweep.preparation import (
        Reading,
        check_settings,
        divided,
        load,
        parameter_names,
        refuse_overlap,
    )
    from rover_sweep.structure_file import load_structures
    from rover_sweep.vehicle_file import load as load_vehicle

    own = load_structures(structures)
    check_writable(Path(out))
    path = Path(vehicle_path(vehicle_file, runs))
    vehicle = load_vehicle(path)
    reading = Reading(columns, filter_overrides(gyro_filter, accel_filter), system)
    sweeps, doublets = divided(load(runs, vehicle, reading, verify_runs))
    checks = load(verify_runs, vehicle, reading, runs) if verify_runs else doublets
    refuse_overlap(sweeps, checks)
    settings = Settings(
        models, fitted, not untied, _swept(wmin, wmax), dict(bands), windows,
        reduction=not no_reduction, keep=parameter_names(keep),
        condition_on=tuple(dict.fromkeys(condition_on)), bootstrap=bootstrap,
    )  # fmt: skip
    check_settings(settings, sweeps)
    identified(sweeps, checks, (vehicle, path), settings, Path(out), as_json, verbose, structures=own)


def _swept(wmin: float | None, wmax: float | None) -> tuple[float, float] | None:
    if wmin is None and wmax is None:
        return None
    if wmin is None or wmax is None or not wmin < wmax:
        raise UsageError(f"give both --wmin and --wmax with wmin < wmax, got {wmin} and {wmax} rad/s")
    return wmin, wmax


def identified(
    sweeps: tuple[Recording, ...],
    checks: tuple[Recording, ...],
    rover: tuple[Vehicle, Path],
    settings: Settings,
    out: Path,
    as_json: bool,
    verbose: bool = False,
    more: Callable[[Identification], RenderableType] | None = None,
    structures: Sequence[ModelStructure] = (),
) -> None:
    """Identifies, writes the report into `out`, and prints comparison, `more`, conclusion and its path.

    structures: of the user's own. as_json: identification.json on stdout, all else on stderr.
    """
    from datetime import datetime

    from rover_sweep.cli.output import echo_json, narration, results, tell_warnings
    from rover_sweep.identify.identification import identify as run_identification
    from rover_sweep.preparation import geometry_of
    from rover_sweep.report.provenance import provenance
    from rover_sweep.report.tables import comparison, conclusion
    from rover_sweep.report.write import write_report

    console, shown = narration(), results(as_json)
    tell_warnings(console, (*sweeps, *checks))
    vehicle, vehicle_file = rover
    command = " ".join(["rover-sweep", *sys.argv[1:]])
    origin = provenance(vehicle, vehicle_file, checks, command, datetime.now().astimezone())
    with console.status("identifying"):
        result = run_identification(sweeps, geometry_of(vehicle), checks, settings, structures)
    with console.status("writing the report") as status:
        files = write_report(result, out, origin, lambda share, what: status.update(f"writing {what}"))
    shown.print(comparison(result, origin, verbose))
    if more is not None:
        shown.print(more(result))
        shown.print()
    shown.print(conclusion(result, origin))
    shown.print(f"report: {files.page}", soft_wrap=True, markup=False)
    if as_json:
        echo_json(files.document.read_text(encoding="utf-8"))
