"""`rover-sweep dry-run`: the whole workflow on a simulated rover, from switch 6 to the report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.driving.simulated import SIMULATORS, rover_text, truth_view, variants, vehicle_in
from rover_sweep.cli.options import NumberRange, output_options
from rover_sweep.cli.vehicle_link import ManoeuvreType, access_options
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep

if TYPE_CHECKING:
    from rover_sweep.vehicle.link.connection import Access


@click.command(name="dry-run")
@click.option(
    "--out",
    type=click.Path(file_okay=False),
    metavar="DIR",
    help="Folder for recordings and report. [default: dry-run, else dry-run-2, ...]",
)
@click.option(
    "--vehicle",
    "simulator",
    default="embedded",
    show_default=True,
    type=click.Choice(SIMULATORS),
    help="The embedded rover, or the real firmware in SITL with the same physics.",
)
@click.option(
    "--ardurover",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="The ArduRover SITL program (else $ROVER_SWEEP_ARDUROVER, else the PATH).",
)
@click.option(
    "--connect", metavar="URL", help="Use a running vehicle: tcp:HOST:PORT, udp:HOST:PORT or a serial port."
)
@access_options
@click.option(
    "--arm-and-drive", is_flag=True, help="With --connect: allow this program to arm and drive that vehicle."
)
@click.option(
    "--rover-file",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="rover.toml of the vehicle behind --connect.",
)
@click.option(
    "--variant",
    default="nominal",
    show_default=True,
    metavar="NAME|FILE",
    help=f"Physics of the simulated rover: {', '.join(variants())}, or a TOML file.",
)
@click.option(
    "--amplitude",
    type=NumberRange(0, min_open=True),
    default=120.0,
    show_default=True,
    metavar="US",
    help="Amplitude of the first sweep, up to 200 us; the second has twice that.",
)
@click.option(
    "--wmin",
    type=NumberRange(0, min_open=True),
    default=0.3,
    show_default=True,
    metavar="RAD/S",
    help="Lowest frequency.",
)
@click.option(
    "--wmax",
    type=NumberRange(0, min_open=True),
    default=25.0,
    show_default=True,
    metavar="RAD/S",
    help="Highest frequency.",
)
@click.option(
    "--trec",
    type=NumberRange(0, min_open=True),
    default=55.0,
    show_default=True,
    metavar="S",
    help="Sweep duration T_rec.",
)
@click.option(
    "--multisine",
    "multisines",
    type=ManoeuvreType(Multisine),
    multiple=True,
    help="Additional multisine: peak in us, rad/s, s; shows 2nd and 3rd harmonics.",
)
@click.option(
    "--bias-sweep",
    "bias_sweeps",
    type=ManoeuvreType(BiasSweep),
    multiple=True,
    help="Additional sweep about a steering offset in us, e.g. 80,100.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="Random seed of noise and road; message timing still varies.",
)
@output_options
def dry_run(
    out: str | None,
    simulator: str,
    ardurover: str | None,
    connect: str | None,
    access: Access,
    arm_and_drive: bool,
    rover_file: str | None,
    variant: str,
    amplitude: float,
    wmin: float,
    wmax: float,
    trec: float,
    multisines: tuple[Multisine, ...],
    bias_sweeps: tuple[BiasSweep, ...],
    seed: int,
    as_json: bool,
    full: bool,
) -> None:
    """Run the whole workflow on a simulated rover: no hardware, about half a minute.

    Starts the embedded rover, talks MAVLink to it over a loopback socket, uploads the sweep, arms,
    throws switch 6, records, judges the coherence after each run, drives a sweep at two amplitudes and
    a doublet, identifies the bicycle, roll-yaw and lumped models, verifies them on the doublet and
    writes a report.
    """
    from rover_sweep.cli.driving.session_display import identify_session, show_session
    from rover_sweep.cli.options import session_folder
    from rover_sweep.session.simulated_rover import DryRun
    from rover_sweep.session.simulated_rover import dry_run as drive

    if connect and not rover_file:
        raise UsageError("--connect needs --rover-file: the masses and lengths of that vehicle")
    settings = DryRun(
        sweeps=tuple(_sweep(factor * amplitude, wmin, wmax, trec) for factor in (1, 2)),
        multisines=multisines,
        bias_sweeps=bias_sweeps,
        simulator="ardurover" if simulator == "ardurover" else "embedded",
        ardurover=Path(ardurover) if ardurover else None,
        variant=variant,
        seed=seed,
        url=connect,
        consent=arm_and_drive,
    )
    _ = settings.plan  # raises a usage error before anything is written
    text = None if rover_file else rover_text(variant)
    folder = session_folder(out, "dry-run", also=() if rover_file else ("rover.toml",))
    rover = vehicle_in(folder, rover_file, text)
    session = show_session(drive(settings, folder, access), folder)
    identify_session(session, rover, as_json, full, None if settings.url else truth_view(variant))


def _sweep(amplitude: float, wmin: float, wmax: float, trec: float) -> Any:
    from rover_sweep.manoeuvre.sweep import Sweep

    try:
        return Sweep(amplitude=amplitude, w_min=wmin, w_max=wmax, t_rec=trec)
    except ValueError as error:
        raise UsageError(str(error)) from error
