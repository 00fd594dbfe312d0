"""`rover-sweep investigate`: drive, diagnose, and choose the next run until the missing effect is settled."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.driving.job import TRIGGERS
from rover_sweep.cli.driving.simulated import (
    refuse_on_simulated,
    refuse_without_simulation,
    simulation_options,
)
from rover_sweep.cli.driving.simulated_vehicle import SIMULATORS
from rover_sweep.cli.types.ground import GroundType
from rover_sweep.cli.types.manoeuvres import LimitType
from rover_sweep.cli.types.options import NumberRange, vehicle_path
from rover_sweep.cli.types.vehicle_link import URL_HELP
from rover_sweep.cli.types.which_vehicle import access_options
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.api.investigation import Bounds
    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.vehicle.link.access import Access
    from rover_sweep.vehicle.run.controls import Trigger

ABOVE_LEAST = 1.2  # a run is so much faster than the least speed of the applet
_PILOT_PATIENCE = 900.0  # s, as `run` waits for the pilot


@click.command()
@click.argument("runs", nargs=-1, metavar="[RUN]...")
@click.option("--connect", metavar="URL", help=URL_HELP)
@access_options
@click.option(
    "--vehicle",
    metavar="FILE|embedded|ardurover",
    help="Vehicle file (default: the session's, or rover.toml here), or the simulated rover to start.",
)
@click.option("--runs", "most", type=click.IntRange(1, 50), default=6, show_default=True, help="Most runs.")
@click.option(
    "--speed",
    type=NumberRange(0.3, 30),
    default=2.4,
    show_default=True,
    metavar="M/S",
    help="Largest speed; with --throttle, the speed at that throttle.",
)
@click.option("--amplitude", type=NumberRange(20, 500), metavar="US", help="Largest steering offset.")
@click.option("--ground", type=GroundType(), help="Length and width in m; larger runs are not chosen.")
@click.option(
    "--battery",
    type=NumberRange(0, 100),
    default=20.0,
    show_default=True,
    metavar="PERCENT",
    help="Drive no further run below this charge, if the rover reports it.",
)
@click.option("--limit", "limits", type=LimitType(), multiple=True, help="Limit of the applet, as in `run`.")
@click.option("--arm", is_flag=True, help="Allow this program to arm and disarm the rover.")
@click.option(
    "--throttle",
    type=click.IntRange(1000, 2000),
    metavar="US",
    help="With --arm: allow this program to drive, with at most this throttle PWM.",
)
@click.option(
    "--throw-switch",
    is_flag=False,
    flag_value="override",
    type=click.Choice(TRIGGERS),
    help="Allow this program to throw the applet's switch, as in `run`.",
)
@click.option("--no-log", is_flag=True, help="Do not download the rover's log; diagnose from telemetry.")
@simulation_options
@click.option(
    "--out",
    type=click.Path(file_okay=False),
    metavar="DIR",
    help="Folder; that of an earlier call is continued.",
)
@click.option("--json", "as_json", is_flag=True, help="Print investigation.json on stdout.")
def investigate(
    runs: tuple[str, ...],
    connect: str | None,
    access: Access,
    vehicle: str | None,
    most: int,
    speed: float,
    amplitude: float | None,
    ground: tuple[float, float] | None,
    battery: float,
    limits: tuple[tuple[str, float], ...],
    arm: bool,
    throttle: int | None,
    throw_switch: Trigger | None,
    no_log: bool,
    out: str | None,
    as_json: bool,
    **simulated: Any,
) -> None:
    """Drive the smallest first set, diagnose, choose the run that decides best what is open, and repeat.

    It ends when the effect is settled, or when runs, ground or battery are used up. Each choice is shown with
    its reason. Before each run it waits for a y at the terminal; Ctrl-C stops the rover and keeps the runs.
    The permissions to arm, drive and throw the switch are those of `run`.

    \b
    rover-sweep investigate --connect URL --vehicle rover.toml --out today
    rover-sweep investigate today            shows the next step only, and drives nothing
    """
    from rover_sweep.api.investigation import Bounds

    applet = dict(limits)
    largest = min((v for v in (amplitude, applet.get("pwm_max")) if v is not None), default=None)
    slowest = ABOVE_LEAST * applet.get("v_min", 0.0)
    bounds = Bounds(most, speed, largest, ground, slowest=slowest)
    if vehicle in SIMULATORS:
        from rover_sweep.cli.driving.investigate_simulated import investigate_simulated

        refuse_on_simulated(connect, arm, throttle)
        _refuse_runs(runs)
        investigate_simulated(vehicle or "", bounds, applet, not no_log, out, as_json, **simulated)
    elif connect:
        _refuse_runs(runs)
        refuse_without_simulation(connect, simulated)
        allowed = arm, throttle, throw_switch or "pilot"
        _on_rover(connect, access, vehicle, bounds, allowed, applet, battery / 100, not no_log, out, as_json)
    else:
        _advice(runs, vehicle, bounds, out, as_json)


def _refuse_runs(runs: tuple[str, ...]) -> None:
    if runs:
        raise UsageError(
            f"{runs[0]} is a recorded run; leave it out to drive (--out continues a session), or leave out "
            "--connect to see the next step"
        )


def _advice(
    runs: tuple[str, ...], vehicle: str | None, bounds: Bounds, out: str | None, as_json: bool
) -> None:
    """Show the next step after recorded runs."""
    from rover_sweep.api.investigation import decided
    from rover_sweep.api.investigation_json import steps_before, write_investigation
    from rover_sweep.api.read import Reading, load_steered
    from rover_sweep.cli.driving.investigating import diagnosing, show_document, show_step
    from rover_sweep.cli.types.folders import check_writable
    from rover_sweep.cli.views.output import narration, print_warnings
    from rover_sweep.data.vehicle_file import load

    if not runs:
        raise UsageError("no rover: give --connect URL, --vehicle embedded or ardurover, or recorded runs")
    rover = load(Path(vehicle_path(vehicle, runs)))
    rover.steering()
    folder = None if out is None else Path(out)
    if folder is not None:
        check_writable(folder)
    earlier = steps_before(folder) if folder else ()
    driven = load_steered(runs, rover, Reading())
    print_warnings(narration(), driven)
    decision = decided(driven, rover, bounds, "", diagnosing(rover))
    show_step(decision)
    if folder is not None:
        write_investigation(folder, [decision], earlier)
    show_document([decision], folder, as_json, earlier)


def _on_rover(
    connect: str,
    access: Access,
    vehicle_file: str | None,
    bounds: Bounds,
    allowed: tuple[bool, int | None, Trigger],
    limits: dict[str, float],
    least: float,
    logs: bool,
    out: str | None,
    as_json: bool,
) -> None:
    """Investigate the rover at `connect`; checks before the drive all that could fail after it."""
    from firmware_params.param_files import read, shipped
    from rover_sweep.api.investigation_json import steps_before
    from rover_sweep.cli.driving.investigating import show_investigation
    from rover_sweep.cli.driving.one_by_one import OneByOne
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.vehicle.link.recorded_transport import RecordedLine, conversation_in
    from rover_sweep.vehicle.link.transport import parse_url
    from rover_sweep.vehicle.run.settings import RunSettings

    if not sys.stdin.isatty():
        raise UsageError("investigate asks before each run, so it needs a terminal; start it in one")
    path = Path(vehicle_path(vehicle_file, (out,) if out else ()))
    vehicle = load(path)
    vehicle.steering()
    parse_url(connect)
    arm, throttle, trigger = allowed
    extra = ({"gcs": 1.0} if throttle is not None else {}) | limits
    settings = RunSettings(arm, throttle, trigger, extra, patience=_PILOT_PATIENCE)
    plan = SessionPlan((), settings, checked=read(shipped("identification")), logs=logs)
    folder = _folder(out)
    steps_before(folder)
    driver = OneByOne(
        connect,
        folder,
        (vehicle, path),
        plan,
        bounds.speed,
        _ask,
        access,
        least,
        lambda: RecordedLine(conversation_in(folder)),
    )
    show_investigation(driver, (vehicle, path), bounds, folder, as_json)


def _ask(display: PlainDisplay, question: str) -> None:
    display.ask(question)


def _folder(out: str | None) -> Path:
    """A session's folder to continue, else a new one."""
    from rover_sweep.cli.types.folders import session_folder
    from rover_sweep.session.folder import is_session

    return Path(out) if out and is_session(Path(out)) else session_folder(out, "investigation")
