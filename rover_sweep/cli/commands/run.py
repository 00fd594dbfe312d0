"""`rover-sweep run`, `dry-run` and `resume`: drive sweeps, record and check them, and identify models."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.driving_options import (
    NO_LOG,
    PERMISSIONS,
    RUN_CALL,
    Permissions,
    RunCall,
    SimulationOptions,
    simulator_option,
)
from rover_sweep.cli.options import (
    AS_JSON,
    FILE,
    FOLDER,
    FULL,
    SESSION,
    VEHICLE,
    Grouped,
    gathered,
    option,
    options,
)
from rover_sweep.cli.vehicle_link import ACCESS, CONNECT

if TYPE_CHECKING:
    from rover_sweep.vehicle.link.connection import Access

_GROUPS = {
    "Rover": "connect vehicle",
    "Manoeuvres": "sweep doublet multisine bias_sweep throttle_sweep",
    "What this program may move": "arm throttle throw_switch",
    "Results": "out diagnose full as_json",
    "Simulated rover": "simulator physics variant seed ardurover",
}


@click.command(cls=Grouped, groups=_GROUPS)
@options
def run(call: RunCall = RUN_CALL) -> None:
    """Drive sweeps and doublets on a rover, record them, check their quality, and identify models.

    The pilot arms, drives and throws the switch (RC6_OPTION 300). This program sets the applet's
    parameters and records; it moves nothing without --arm, --throttle or --throw-switch. Switch low ends a
    run at once, without the laptop. Ctrl-C also ends it, and continues to log and report with the complete
    runs. Without any manoeuvre given: sweeps of 120 and 240 us and a doublet of 150 us.

    \b
    rover-sweep run --connect /dev/ttyUSB0,57600 --vehicle rover.toml \\
      --sweep 120 --sweep 240,wmax=20 --doublet 150 --out today

    With --simulator ardurover the whole workflow runs on the official firmware in simulation: the program
    uploads the applet by MAVLink FTP, sets parameters, reboots, arms and drives.
    """
    from rover_sweep.cli.driving.driven import run_and_identify

    run_and_identify(call, "run")


DRY_RUN = gathered(
    RunCall,
    connect=None,
    access=None,
    vehicle=option("Vehicle file to use instead of the simulated rover's true numbers.", FILE),
    allowed=gathered(Permissions, arm=False, throttle=None),
    simulation=gathered(SimulationOptions, simulator=simulator_option("embedded")),
    out=option("Folder for recordings and report. [default: dry-run, else dry-run-2, ...]", FOLDER),
)


@click.command("dry-run")
@options
def dry_run(call: RunCall = DRY_RUN) -> None:
    """Run the whole workflow on a simulated rover: no hardware, about half a minute.

    It is `run` with --simulator embedded: starts the embedded rover, talks MAVLink to it over a loopback
    socket, uploads the sweep, arms, throws switch 6, records, judges the coherence after each run, drives a
    sweep at two amplitudes and a doublet, identifies the bicycle, roll-yaw and lumped models, verifies them
    on the doublet and writes a report.
    """
    from rover_sweep.cli.driving.driven import run_and_identify

    run_and_identify(call, "dry-run")


@click.command()
@options
def resume(
    folder: Path = SESSION,
    connect: str = CONNECT,
    access: Access = ACCESS,
    vehicle: str | None = VEHICLE,
    allowed: Permissions = PERMISSIONS,
    no_log: bool = NO_LOG,
    as_json: bool = AS_JSON,
    full: bool = FULL,
) -> None:
    """Drive the remaining runs of the session in FOLDER, and identify models from all its runs.

    The applet's limits stay as at the start of the session, except those given with --limit. Permissions are
    not kept: without --arm, --throttle and --throw-switch the pilot arms, drives and throws the switch.
    Switch low ends a run at once, without the laptop; so does Ctrl-C.
    """
    from rover_sweep.cli.driving.driven import on_rover
    from rover_sweep.cli.driving.session_display import identify_session

    session, rover = on_rover(folder, (), connect, access, vehicle, allowed, not no_log)
    identify_session(session, rover, as_json, full)
