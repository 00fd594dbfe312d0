"""`rover-sweep dry-run`: the whole workflow on a simulated rover, from switch 6 to the report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from rover_sweep.cli.driving.simulated import SIMULATORS, folder_with_rover, truth_view, variants
from rover_sweep.cli.options import ARDUROVER, AS_JSON, FILE, FOLDER, FULL, POSITIVE, option, options
from rover_sweep.cli.vehicle_link import ACCESS, ManoeuvreType
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import FIRST_SWEEPS, BiasSweep

if TYPE_CHECKING:
    from rover_sweep.vehicle.link.connection import Access


@click.command(name="dry-run")
@options
def dry_run(
    out: str | None = option(
        "Folder for recordings and report. [default: dry-run, else dry-run-2, ...]", FOLDER
    ),
    vehicle: Literal["embedded", "ardurover"] = option(
        "The embedded rover, or the real firmware in SITL with the same physics.",
        click.Choice(SIMULATORS),
        default="embedded",
    ),
    ardurover: str | None = ARDUROVER,
    connect: str | None = option(
        "Use a running vehicle: tcp:HOST:PORT, udp:HOST:PORT or a serial port.", metavar="URL"
    ),
    access: Access = ACCESS,
    arm_and_drive: bool = option("With --connect: allow this program to arm and drive that vehicle."),
    rover_file: str | None = option("rover.toml of the vehicle behind --connect.", FILE),
    variant: str = option(
        f"Physics of the simulated rover: {', '.join(variants())}, or a TOML file.",
        metavar="NAME|FILE",
        default="nominal",
    ),
    amplitude: float = option(
        "Amplitude of the first sweep, up to 200 us; the second has twice that.",
        POSITIVE,
        "US",
        default=FIRST_SWEEPS[0].amplitude,
    ),
    wmin: float = option("Lowest frequency.", POSITIVE, "RAD/S", default=0.3),
    wmax: float = option("Highest frequency.", POSITIVE, "RAD/S", default=25.0),
    trec: float = option("Sweep duration T_rec.", POSITIVE, "S", default=55.0),
    multisine: tuple[Multisine, ...] = option(
        "Additional multisine: peak in us, rad/s, s; shows 2nd and 3rd harmonics.",
        ManoeuvreType(Multisine),
        multiple=True,
    ),
    bias_sweep: tuple[BiasSweep, ...] = option(
        "Additional sweep about a steering offset in us, e.g. 80,100.",
        ManoeuvreType(BiasSweep),
        multiple=True,
    ),
    seed: int = option(
        "Random seed of noise and road; message timing still varies.", click.IntRange(min=0), default=1
    ),
    as_json: bool = AS_JSON,
    full: bool = FULL,
) -> None:
    """Run the whole workflow on a simulated rover: no hardware, about half a minute.

    Starts the embedded rover, talks MAVLink to it over a loopback socket, uploads the sweep, arms,
    throws switch 6, records, judges the coherence after each run, drives a sweep at two amplitudes and
    a doublet, identifies the bicycle, roll-yaw and lumped models, verifies them on the doublet and
    writes a report.
    """
    from rover_sweep.cli.driving.session_display import identify_session, show_session
    from rover_sweep.session.simulated_rover import DryRun
    from rover_sweep.session.simulated_rover import dry_run as drive

    if connect and not rover_file:
        raise UsageError("--connect needs --rover-file: the masses and lengths of that vehicle")
    settings = DryRun(
        sweeps=tuple(_sweep(factor * amplitude, wmin, wmax, trec) for factor in (1, 2)),
        multisines=multisine,
        bias_sweeps=bias_sweep,
        simulator=vehicle,
        ardurover=Path(ardurover) if ardurover else None,
        variant=variant,
        seed=seed,
        url=connect,
        consent=arm_and_drive,
    )
    _ = settings.plan  # raises a usage error before anything is written
    folder, rover = folder_with_rover(out, "dry-run", rover_file, variant)
    session = show_session(drive(settings, folder, access), folder)
    identify_session(session, rover, as_json, full, None if settings.url else truth_view(variant))


def _sweep(amplitude: float, wmin: float, wmax: float, trec: float) -> Any:
    from rover_sweep.manoeuvre.sweep import Sweep

    try:
        return Sweep(amplitude=amplitude, w_min=wmin, w_max=wmax, t_rec=trec)
    except ValueError as error:
        raise UsageError(str(error)) from error
