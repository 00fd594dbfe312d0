"""`rover-sweep run`: drive sweeps on a rover, record and check them, and identify models."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.driving.job import TRIGGERS, Job, announce, diagnose_session, folder_for
from rover_sweep.cli.driving.simulated import (
    SIMULATORS,
    on_simulated,
    refuse_on_simulated,
    refuse_without_simulation,
    simulation_options,
)
from rover_sweep.cli.options import output_options, vehicle_path
from rover_sweep.cli.vehicle_link import URL_HELP, LimitType, ManoeuvreType, access_options, connect_option
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Sweep, ThrottleSweep

if TYPE_CHECKING:
    from collections.abc import Callable

    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.session.content import Content
    from rover_sweep.session.session import SessionPlan, SessionRun
    from rover_sweep.vehicle.events import Event, SessionFinished
    from rover_sweep.vehicle.link.connection import Access
    from rover_sweep.vehicle.run.controls import RunSettings, Trigger

_PILOT_PATIENCE = 900.0  # s to wait for the pilot to arm, throw the switch, or disarm at the end


@click.command()
@click.option("--connect", metavar="URL", help=URL_HELP)
@access_options
@click.option(
    "--vehicle",
    metavar="FILE|embedded|ardurover",
    help="Vehicle file (default: rover.toml here), or the simulated rover to start.",
)
@click.option(
    "--sweep",
    "sweeps",
    type=ManoeuvreType(Sweep),
    multiple=True,
    help="Sweep in us, rad/s, s; or by name, e.g. 150,wmax=20. May be repeated.",
)
@click.option(
    "--doublet",
    "doublets",
    type=ManoeuvreType(Doublet),
    multiple=True,
    help="Doublet in us and s, to verify the models. May be repeated.",
)
@click.option(
    "--multisine",
    "multisines",
    type=ManoeuvreType(Multisine),
    multiple=True,
    help="Multisine: peak in us, rad/s, s; shows 2nd and 3rd harmonics. May be repeated.",
)
@click.option(
    "--bias-sweep",
    "bias_sweeps",
    type=ManoeuvreType(BiasSweep),
    multiple=True,
    help="Sweep about a steering offset in us, e.g. 80,100. May be repeated.",
)
@click.option(
    "--throttle-sweep",
    "throttle_sweeps",
    type=ManoeuvreType(ThrottleSweep),
    multiple=True,
    help="Sweep of the throttle about the pilot's, in us, rad/s, s, for the speed gains. May be repeated.",
)
@click.option(
    "--limit",
    "limits",
    type=LimitType(),
    multiple=True,
    help="Limit of the applet, e.g. v_max=3. [default: as set on the rover]",
)
@click.option("--arm", is_flag=True, help="Allow this program to arm and disarm the rover.")
@click.option(
    "--throttle",
    type=click.IntRange(1000, 2000),
    metavar="US",
    help="With --arm: allow this program to drive, with this throttle PWM.",
)
@click.option(
    "--throw-switch",
    is_flag=False,
    flag_value="override",
    type=click.Choice(TRIGGERS),
    help="Allow this program to throw the applet's switch: by RC override (default) or by "
    "MAV_CMD_DO_AUX_FUNCTION (aux); pilot: not allowed.",
)
@click.option("--no-log", is_flag=True, help="Do not download the rover's log; identify from telemetry.")
@click.option("--diagnose", is_flag=True, help="Run `diagnose` on the runs at the end.")
@simulation_options
@click.option(
    "--out",
    type=click.Path(file_okay=False),
    metavar="DIR",
    help="Folder for recordings and report. [default: run, else run-2, ...]",
)
@output_options
def run(
    connect: str | None,
    access: Access,
    vehicle: str | None,
    sweeps: tuple[Sweep, ...],
    doublets: tuple[Doublet, ...],
    multisines: tuple[Multisine, ...],
    bias_sweeps: tuple[BiasSweep, ...],
    throttle_sweeps: tuple[ThrottleSweep, ...],
    limits: tuple[tuple[str, float], ...],
    arm: bool,
    throttle: int | None,
    throw_switch: Trigger | None,
    no_log: bool,
    diagnose: bool,
    out: str | None,
    as_json: bool,
    full: bool,
    **simulated: Any,
) -> None:
    """Drive sweeps and doublets on a rover, record them, check their quality, and identify models.

    The pilot arms, drives and throws the switch (RC6_OPTION 300). This program sets the applet's
    parameters and records; it moves nothing without --arm, --throttle or --throw-switch. Switch low ends a
    run at once, without the laptop. Ctrl-C also ends it, and continues to log and report with the complete
    runs. Without any manoeuvre given: two sweeps and a doublet of 150 us.

    \b
    rover-sweep run --connect /dev/ttyUSB0,57600 --vehicle rover.toml \\
      --sweep 120 --sweep 200,wmax=20 --doublet 150 --out today

    With --vehicle ardurover the whole workflow runs on the official firmware in simulation: the program
    uploads the applet by MAVLink FTP, sets parameters, reboots, arms and drives.
    """
    from rover_sweep.cli.driving.session_display import identify_session

    runs = _planned(sweeps, multisines, bias_sweeps, doublets, throttle_sweeps)
    job = Job(runs, dict(limits), throw_switch, not no_log)
    if vehicle in SIMULATORS:
        refuse_on_simulated(connect, arm, throttle)
        rover, session, more = on_simulated(job, vehicle, out, **simulated)
    else:
        refuse_without_simulation(connect, simulated)
        rover, session, more = *_on_rover(job, connect or "", access, vehicle, out, arm, throttle), None
    identify_session(session, rover, as_json, full, more)
    if diagnose and len(throttle_sweeps) < len(runs):
        diagnose_session(session, rover)


def _on_rover(
    job: Job,
    connect: str,
    access: Access,
    vehicle_file: str | None,
    out: str | None,
    arm: bool,
    throttle: int | None,
) -> tuple[tuple[Vehicle, Path], SessionFinished]:
    """The session on the rover at `connect`; checks before the drive all that could fail after it."""
    from firmware_params.param_files import read, shipped
    from rover_sweep.cli.driving.session_display import show_session
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.manoeuvre.sweep import parameters_of
    from rover_sweep.session.session import SessionPlan, drive
    from rover_sweep.vehicle.link.recorded_transport import RecordedLine, conversation_in
    from rover_sweep.vehicle.link.transport import parse_url
    from rover_sweep.vehicle.run.controls import RunSettings

    path = Path(vehicle_path(vehicle_file))
    vehicle = load(path)
    vehicle.steering()
    parse_url(connect)
    extra = ({"gcs": 1.0} if throttle is not None else {}) | job.limits
    settings = RunSettings(arm, throttle, job.trigger or "pilot", extra, patience=_PILOT_PATIENCE)
    plan = SessionPlan(job.runs, settings, checked=read(shipped("identification")), logs=job.logs)
    for planned in plan.runs:
        parameters_of(planned.manoeuvre, **extra)
    folder = folder_for(out)
    announce(plan, folder)
    with RecordedLine(conversation_in(folder)) as line:
        events = drive(connect, folder, plan, line, path, access)
        session = show_session(events, folder, talk=True, go_on=True, answer=_asking(settings), logs=job.logs)
    return (vehicle, path), session


def _planned(
    sweeps: tuple[Sweep, ...],
    multisines: tuple[Multisine, ...],
    bias_sweeps: tuple[BiasSweep, ...],
    doublets: tuple[Doublet, ...],
    throttle_sweeps: tuple[ThrottleSweep, ...],
) -> tuple[SessionRun, ...]:
    """Named runs in driving order; two sweeps and a doublet if no manoeuvre is given."""
    from rover_sweep.session.session import SessionRun

    if not (sweeps or multisines or bias_sweeps or doublets or throttle_sweeps):
        sweeps, doublets = (Sweep(), Sweep()), (Doublet(),)
    return (
        *(SessionRun(f"sweep{n}", sweep) for n, sweep in enumerate(sweeps, 1)),
        *(SessionRun(f"multisine{n}", multisine) for n, multisine in enumerate(multisines, 1)),
        *(SessionRun(f"bias-sweep{n}", sweep) for n, sweep in enumerate(bias_sweeps, 1)),
        *(SessionRun(f"doublet{n}" if n > 1 else "doublet", d) for n, d in enumerate(doublets, 1)),
        *(SessionRun(f"throttle{n}", sweep) for n, sweep in enumerate(throttle_sweeps, 1)),
    )


def _asking(settings: RunSettings) -> Callable[[PlainDisplay, Event], None]:
    """Asks before each run if this program arms the rover and stdin is a terminal."""
    from rover_sweep.vehicle.events import RunStarted

    def answer(display: PlainDisplay, event: Event) -> None:
        if isinstance(event, RunStarted) and settings.arm and sys.stdin.isatty():
            display.ask(f"{event.name} arms the rover: is the area clear? y starts the run, Ctrl-C stops")

    return answer


# `rover-sweep resume`: drive the remaining runs of a session, as `run` does, into the same folder.


# s, as `run` waits for the pilot


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@connect_option
@click.option(
    "--vehicle",
    "vehicle_file",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="Vehicle file (default: the session's, or rover.toml here).",
)
@click.option("--arm", is_flag=True, help="Allow this program to arm and disarm the rover.")
@click.option(
    "--throttle",
    type=click.IntRange(1000, 2000),
    metavar="US",
    help="With --arm: allow this program to drive, with this throttle PWM.",
)
@click.option(
    "--throw-switch",
    is_flag=False,
    flag_value="override",
    type=click.Choice(TRIGGERS),
    default="pilot",
    help="Allow this program to throw the applet's switch, as in `run`.",
)
@click.option("--no-log", is_flag=True, help="Do not download the rover's log.")
@output_options
def resume(
    folder: Path,
    connect: str,
    access: Access,
    vehicle_file: str | None,
    arm: bool,
    throttle: int | None,
    throw_switch: Trigger,
    no_log: bool,
    as_json: bool,
    full: bool,
) -> None:
    """Drive the remaining runs of the session in FOLDER, and identify models from all its runs.

    The applet's limits stay as at the start of the session. Permissions are not kept: without --arm,
    --throttle and --throw-switch the pilot arms, drives and throws the switch. Switch low ends a run at
    once, without the laptop; so does Ctrl-C.
    """
    from rover_sweep.cli.driving.session_display import identify_session, show_session
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.session.folder import read_folder
    from rover_sweep.session.session import drive
    from rover_sweep.vehicle.link.transport import parse_url

    path = Path(vehicle_path(vehicle_file, (str(folder),)))
    vehicle = load(path)
    vehicle.steering()
    parse_url(connect)
    plan = _plan(read_folder(folder), folder, arm, throttle, throw_switch, not no_log)

    def answer(display: PlainDisplay, event: Event) -> None:
        from rover_sweep.vehicle.events import RunStarted

        if isinstance(event, RunStarted) and arm and sys.stdin.isatty():
            display.ask(f"{event.name} arms the rover: is the area clear? y starts the run, Ctrl-C stops")

    announce(plan, folder)
    events = drive(connect, folder, plan, vehicle_file=path, access=access)
    session = show_session(events, folder, talk=True, go_on=True, answer=answer)
    identify_session(session, (vehicle, path), as_json, full)


def _plan(
    content: Content, folder: Path, arm: bool, throttle: int | None, trigger: Trigger, logs: bool
) -> SessionPlan:
    """The session's remaining runs with its limits and the permissions given now."""
    from firmware_params.param_files import read, shipped
    from rover_sweep.manoeuvre.sweep import parameters_of
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.vehicle.run.controls import RunSettings

    if not content.to_drive:
        raise UsageError(f"no runs remain in {folder}; identify models with: rover-sweep identify {folder}")
    extra = dict(content.settings.get("extra", {})) | ({"gcs": 1.0} if throttle is not None else {})
    settings = RunSettings(arm, throttle, trigger, extra, patience=_PILOT_PATIENCE)
    for planned in content.to_drive:
        parameters_of(planned.manoeuvre, **extra)
    return SessionPlan(content.plan, settings, checked=read(shipped("identification")), logs=logs)
