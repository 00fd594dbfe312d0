"""`rover-sweep resume`: drive the remaining runs of a session, as `run` does, into the same folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.driving.job import TRIGGERS, announce
from rover_sweep.cli.types.options import output_options, vehicle_path
from rover_sweep.cli.types.vehicle_link import connect_option
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.session.content import Content
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.vehicle.events import Event
    from rover_sweep.vehicle.link.access import Access
    from rover_sweep.vehicle.run.controls import Trigger

_PILOT_PATIENCE = 900.0  # s, as `run` waits for the pilot


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
    from rover_sweep.manoeuvre.applet_values import parameters_of
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.vehicle.run.settings import RunSettings

    if not content.to_drive:
        raise UsageError(f"no runs remain in {folder}; identify models with: rover-sweep identify {folder}")
    extra = dict(content.settings.get("extra", {})) | ({"gcs": 1.0} if throttle is not None else {})
    settings = RunSettings(arm, throttle, trigger, extra, patience=_PILOT_PATIENCE)
    for planned in content.to_drive:
        parameters_of(planned.manoeuvre, **extra)
    return SessionPlan(content.plan, settings, checked=read(shipped("identification")), logs=logs)
