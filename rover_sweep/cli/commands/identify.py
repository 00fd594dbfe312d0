"""`rover-sweep identify`: identify models from recorded runs and write a report."""

from __future__ import annotations

import shlex
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.options import (
    AS_JSON,
    BAND,
    FILE,
    FULL,
    POSITIVE,
    READING,
    REPORT,
    VEHICLE,
    Grouped,
    argument,
    check_report_folder,
    found_vehicle,
    names_type,
    numbers_type,
    option,
    options,
)
from rover_sweep.data.recording import OUTPUTS
from rover_sweep.data.vehicle_file import MODELS
from rover_sweep.errors import DataRefused, UsageError

if TYPE_CHECKING:
    from rover_sweep.api.read import Reading
    from rover_sweep.identification.identify_speed import SpeedResult

REPLACED = ("report.html", "speed.html", "driving.html", "pictures/*", "models/*")  # by a new report


@click.command(
    cls=Grouped,
    groups={
        "Runs": "vehicle_file wheelbase verify columns",
        "Results": "out full as_json units",
        "Models": "models fit structure untied no_reduction keep bootstrap",
        "Frequencies": "band wmin wmax windows condition_on",
    },
)
@options
def identify(
    runs: tuple[str, ...] = argument("RUN...", nargs=-1, required=True),
    vehicle_file: str | None = VEHICLE,
    verify: tuple[str, ...] = option(
        "Run for verification only, such as a doublet; may be repeated.", metavar="RUN", multiple=True
    ),
    models: tuple[str, ...] = option(
        "Models to identify.", names_type(allowed=MODELS), default=",".join(MODELS)
    ),
    fit: tuple[str, ...] = option(
        "Responses used in the fit; all four are reported.", names_type(allowed=OUTPUTS), default="r,ay,p"
    ),
    structure: tuple[str, ...] = option(
        "Additional model structure of your own (TOML); may be repeated.", FILE, multiple=True
    ),
    condition_on: tuple[str, ...] = option(
        "Second input whose effect is removed from the responses, e.g. throttle.",
        metavar="CHANNEL",
        multiple=True,
    ),
    untied: bool = option("Fit Cf and Cr separately instead of one C for both axles."),
    no_reduction: bool = option("Keep all parameters, even those the data cannot determine."),
    keep: tuple[str, ...] = option(
        "Parameter that the structure reduction keeps free, e.g. Ixx or Y_phi.", metavar="NAME", multiple=True
    ),
    band: tuple[tuple[str, tuple[float, float]], ...] = option(
        "Frequency band used of a response, rad/s. [default: from its coherence]", BAND, multiple=True
    ),
    wmin: float | None = option("Lowest swept frequency.", POSITIVE, "RAD/S"),
    wmax: float | None = option("Highest swept frequency.", POSITIVE, "RAD/S"),
    windows: tuple[float, ...] | None = option(
        "Window lengths of the spectra, s.", numbers_type(), "S,S,..."
    ),
    bootstrap: int = option(
        "Number of replicates for the 90 % intervals of the parameters; 0: no intervals.",
        click.IntRange(min=0),
        "N",
        default=200,
    ),
    wheelbase: float | None = option(
        "Wheelbase, where there is no vehicle file: gives K_us in deg/g and the steering ratio.",
        POSITIVE,
        "M",
    ),
    units: str = option(
        "Accelerations in m/s^2 or, as in the paper, in ft/s^2; files for programs stay in SI.",
        click.Choice(["SI", "paper"], case_sensitive=False),
        default="SI",
    ),
    reading: Reading = READING,
    out: str = REPORT,
    as_json: bool = AS_JSON,
    full: bool = FULL,
) -> None:
    """Identify bicycle, roll-yaw and lumped models from recorded RUNs and write a report.

    RUN is a .BIN, a .tlog, a file of another system (.csv, .mcap, ...), both logs of one drive as
    log.BIN+log.tlog, or a session's folder. Several runs are fitted together. Doublets among them are used to
    verify the models, unless --verify names other runs. Throttle sweeps are recognised, and identified into
    DIR/speed.html and DIR/speed.json.

    Without a vehicle file, or without a sweep, RUN may be any driving, such as a mission: the answer is then
    how much and how late the rover turns for its steering, in DIR/driving.html and DIR/driving.json.
    """
    from rover_sweep.api.identify import parameter_names
    from rover_sweep.api.read import fitted_and_verified, load_steered, load_structures
    from rover_sweep.cli.driving.any_driving import driving_of, show_driving, show_instead
    from rover_sweep.cli.driving.shown_results import add_steering, show_identified
    from rover_sweep.data.vehicle_file import load as load_vehicle
    from rover_sweep.identification.grouping import Settings

    if (wmin is None) != (wmax is None) or (wmin is not None and wmax is not None and wmin >= wmax):
        raise UsageError(f"give both --wmin and --wmax with wmin < wmax, got {wmin} and {wmax} rad/s")
    own = load_structures(structure)
    check_report_folder(Path(out), ("identification.json", "speed.json", "driving.json"), REPLACED)
    speed, runs = _of_throttle(runs, Path(out), as_json)
    if not runs:
        return
    found = found_vehicle(vehicle_file, runs)
    if found is None:
        why = "No vehicle file: these are the numbers that need none. Models need one (--vehicle)."
        show_driving(driving_of(runs, reading, wheelbase), Path(out), as_json, why)
        return
    path = Path(found)
    vehicle = load_vehicle(path)
    try:
        given = load_steered(runs, vehicle, reading, verify)
    except DataRefused as refused:
        if not show_instead(runs, reading, path, Path(out), as_json, str(refused)):
            raise
        return
    if all(run.kind == "other" and "pwm" in run and run.firmware for run in given) and show_instead(
        runs, reading, path, Path(out), as_json, "there is no sweep in this driving"
    ):
        return
    verified = load_steered(verify, vehicle, reading, runs) if verify else ()
    sweeps, checks = fitted_and_verified(given, verified)
    settings = Settings(
        models,
        fit,
        not untied,
        (wmin, wmax) if wmin is not None and wmax is not None else None,
        dict(band),
        windows,
        reduction=not no_reduction,
        keep=parameter_names(keep),
        condition_on=tuple(dict.fromkeys(condition_on)),
        bootstrap=bootstrap,
    )
    again: list[str] = [
        *runs,
        *(word for run in verify for word in ("--hold-out", run)),
        "--vehicle",
        str(path),
    ]
    show_identified(
        sweeps,
        checks,
        (vehicle, path),
        settings,
        Path(out),
        as_json,
        full,
        structures=own,
        units=units,
        again=shlex.join([*again, *reading.words]),
    )
    add_steering(speed, Path(out))


def _of_throttle(
    runs: tuple[str, ...], out: Path, as_json: bool
) -> tuple[SpeedResult | None, tuple[str, ...]]:
    """Identify the speed from the throttle sweeps among the runs; the runs that are not of these alone."""
    from rover_sweep.api.read import load_runs
    from rover_sweep.api.speed import throttle_sweeps
    from rover_sweep.cli.driving.shown_results import show_speed

    swept = throttle_sweeps(runs)
    if not swept:
        return None, runs
    steered = []
    for run in runs:  # those that hold runs of the steering too
        with suppress(DataRefused):
            if not throttle_sweeps((run,)) or load_runs((run,), None, None):
                steered.append(run)
    return show_speed(swept, out, as_json, alone=not steered), tuple(steered)
