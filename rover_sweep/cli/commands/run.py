"""`rover-sweep run`: drive sweeps on a rover, record and check them, and identify models."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.driving.job import Job, announce, diagnose_session, folder_for
from rover_sweep.cli.driving.simulated import (
    SIMULATION,
    SIMULATORS,
    SimulationOptions,
    on_simulated,
    refuse_on_simulated,
    refuse_without_simulation,
)
from rover_sweep.cli.options import (
    AS_JSON,
    FOLDER,
    FULL,
    SESSION,
    VEHICLE,
    Grouped,
    option,
    options,
    vehicle_path,
)
from rover_sweep.cli.vehicle_link import (
    ACCESS,
    ARM,
    CONNECT,
    LIMIT_SET,
    PILOT_PATIENCE,
    SWITCH_AS_RUN,
    THROTTLE,
    URL_HELP,
    ManoeuvreType,
    throw_switch_option,
)
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import FIRST_DOUBLET, FIRST_SWEEPS, BiasSweep, Doublet, Sweep, ThrottleSweep

if TYPE_CHECKING:
    from collections.abc import Callable

    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.session.content import Content
    from rover_sweep.session.session import SessionPlan, SessionRun
    from rover_sweep.vehicle.events import Event, SessionFinished
    from rover_sweep.vehicle.link.connection import Access
    from rover_sweep.vehicle.run.controls import RunSettings, Trigger


_THROW_SWITCH = throw_switch_option(
    "Allow this program to throw the applet's switch: by RC override (default) or by "
    "MAV_CMD_DO_AUX_FUNCTION (aux); pilot: not allowed."
)


@click.command(
    cls=Grouped,
    groups={
        "Rover": "connect vehicle",
        "Manoeuvres": "sweep doublet multisine bias_sweep throttle_sweep",
        "What this program may move": "arm throttle throw_switch",
        "Results": "out diagnose full as_json",
        "Simulated rover": "physics variant rover_file seed ardurover",
    },
)
@options
def run(
    connect: str | None = option(URL_HELP, metavar="URL"),
    access: Access = ACCESS,
    vehicle: str | None = option(
        "Vehicle file (default: rover.toml here), or the simulated rover to start.",
        metavar="FILE|embedded|ardurover",
    ),
    sweep: tuple[Sweep, ...] = option(
        "Sweep in us, rad/s, s; or by name, e.g. 150,wmax=20. May be repeated.",
        ManoeuvreType(Sweep),
        multiple=True,
    ),
    doublet: tuple[Doublet, ...] = option(
        "Doublet in us and s, to verify the models. May be repeated.", ManoeuvreType(Doublet), multiple=True
    ),
    multisine: tuple[Multisine, ...] = option(
        "Multisine: peak in us, rad/s, s; shows 2nd and 3rd harmonics. May be repeated.",
        ManoeuvreType(Multisine),
        multiple=True,
    ),
    bias_sweep: tuple[BiasSweep, ...] = option(
        "Sweep about a steering offset in us, e.g. 80,100. May be repeated.",
        ManoeuvreType(BiasSweep),
        multiple=True,
    ),
    throttle_sweep: tuple[ThrottleSweep, ...] = option(
        "Sweep of the throttle about the pilot's, in us, rad/s, s, for the speed gains. May be repeated.",
        ManoeuvreType(ThrottleSweep),
        multiple=True,
    ),
    limit: tuple[tuple[str, float], ...] = LIMIT_SET,
    arm: bool = ARM,
    throttle: int | None = THROTTLE,
    throw_switch: Trigger | None = _THROW_SWITCH,
    no_log: bool = option("Do not download the rover's log; identify from telemetry."),
    diagnose: bool = option("Run `diagnose` on the runs at the end."),
    simulation: SimulationOptions = SIMULATION,
    out: str | None = option("Folder for recordings and report. [default: run, else run-2, ...]", FOLDER),
    as_json: bool = AS_JSON,
    full: bool = FULL,
) -> None:
    """Drive sweeps and doublets on a rover, record them, check their quality, and identify models.

    The pilot arms, drives and throws the switch (RC6_OPTION 300). This program sets the applet's
    parameters and records; it moves nothing without --arm, --throttle or --throw-switch. Switch low ends a
    run at once, without the laptop. Ctrl-C also ends it, and continues to log and report with the complete
    runs. Without any manoeuvre given: sweeps of 120 and 240 us and a doublet of 150 us.

    \b
    rover-sweep run --connect /dev/ttyUSB0,57600 --vehicle rover.toml \\
      --sweep 120 --sweep 240,wmax=20 --doublet 150 --out today

    With --vehicle ardurover the whole workflow runs on the official firmware in simulation: the program
    uploads the applet by MAVLink FTP, sets parameters, reboots, arms and drives.
    """
    from rover_sweep.cli.driving.session_display import identify_session

    runs = _planned(sweep, multisine, bias_sweep, doublet, throttle_sweep)
    job = Job(runs, dict(limit), throw_switch, not no_log)
    if vehicle in SIMULATORS:
        refuse_on_simulated(connect, arm, throttle)
        rover, session, more = on_simulated(job, vehicle, out, simulation)
    else:
        refuse_without_simulation(connect, simulation)
        rover, session, more = *_on_rover(job, connect or "", access, vehicle, out, arm, throttle), None
    identify_session(session, rover, as_json, full, more)
    if diagnose and len(throttle_sweep) < len(runs):
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
    settings = RunSettings(arm, throttle, job.trigger or "pilot", extra, patience=PILOT_PATIENCE)
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
        sweeps, doublets = FIRST_SWEEPS, (FIRST_DOUBLET,)
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


@click.command()
@options
def resume(
    folder: Path = SESSION,
    connect: str = CONNECT,
    access: Access = ACCESS,
    vehicle: str | None = VEHICLE,
    arm: bool = ARM,
    throttle: int | None = THROTTLE,
    throw_switch: Trigger | None = SWITCH_AS_RUN,
    no_log: bool = option("Do not download the rover's log."),
    as_json: bool = AS_JSON,
    full: bool = FULL,
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

    path = Path(vehicle_path(vehicle, (str(folder),)))
    rover = load(path)
    rover.steering()
    parse_url(connect)
    plan = _plan(read_folder(folder), folder, arm, throttle, throw_switch or "pilot", not no_log)
    announce(plan, folder)
    events = drive(connect, folder, plan, vehicle_file=path, access=access)
    session = show_session(events, folder, talk=True, go_on=True, answer=_asking(plan.settings))
    identify_session(session, (rover, path), as_json, full)


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
    settings = RunSettings(arm, throttle, trigger, extra, patience=PILOT_PATIENCE)
    for planned in content.to_drive:
        parameters_of(planned.manoeuvre, **extra)
    return SessionPlan(content.plan, settings, checked=read(shipped("identification")), logs=logs)
