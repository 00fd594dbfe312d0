"""`run --vehicle embedded|ardurover`: start a simulated rover and run the whole workflow on it.

The rover starts with factory settings: applet and parameters are installed as on a real one. The program
arms and drives it without asking.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.driving.job import Job, announce
from rover_sweep.cli.driving.simulated_vehicle import (
    firmware_rover_text,
    rover_text,
    truth_view,
    variants,
    vehicle_in,
)
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from rover_sweep.cli.views.display import PlainDisplay
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.identification.pipeline import Identification
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.session.simulated_rover import SimulatedRover
    from rover_sweep.vehicle.events import Event, SessionFinished

    Numbers = Callable[[Identification], RenderableType]

_LIMITS = {"gcs": 1.0, "v_min": 1.0, "v_max": 5.0}
_PWM_MAX = 250.0  # us, default of SWP_PWM_MAX
_DEFAULTS = {"physics": "plant", "variant": "nominal", "seed": 1}


def simulation_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """--physics, --ardurover, --variant, --seed and --rover-file, of a rover that is simulated."""
    for decorate in (
        click.option(
            "--rover-file",
            type=click.Path(dir_okay=False),
            metavar="FILE",
            help="Simulated rover: vehicle file to use instead of the true one.",
        ),
        click.option(
            "--seed",
            type=click.IntRange(min=0),
            default=_DEFAULTS["seed"],
            help="Simulated rover: random seed of noise and road. [default: 1]",
        ),
        click.option(
            "--variant",
            default=_DEFAULTS["variant"],
            metavar="NAME|FILE",
            help=f"Simulated rover: physics; {', '.join(variants())}, or a TOML file. [default: nominal]",
        ),
        click.option(
            "--ardurover",
            type=click.Path(dir_okay=False),
            metavar="FILE",
            help="The ArduRover SITL program (else $ROVER_SWEEP_ARDUROVER, else the PATH).",
        ),
        click.option(
            "--physics",
            type=click.Choice(("plant", "own")),
            default=_DEFAULTS["physics"],
            help="Physics for the firmware: our plant, or the firmware's own rover. [default: plant]",
        ),
    ):
        command = decorate(command)
    return command


def refuse_on_simulated(connect: str | None, arm: bool, throttle: int | None) -> None:
    """UsageError for options that only make sense with an existing rover."""
    if connect:
        raise UsageError("--vehicle embedded or ardurover starts its own rover; remove --connect")
    if arm or throttle is not None:
        raise UsageError("a simulated rover is always armed and driven; remove --arm and --throttle")


def refuse_without_simulation(connect: str | None, options: Mapping[str, Any]) -> None:
    """UsageError for options of a simulated rover without one, and for no rover at all."""
    if not connect:
        raise UsageError(
            "no rover: give --connect URL, or --vehicle embedded or ardurover for a simulated one"
        )
    for name, value in options.items():
        if value != _DEFAULTS.get(name):
            raise UsageError(f"--{name.replace('_', '-')} is for --vehicle embedded or ardurover")


def on_simulated(
    job: Job,
    simulator: str,
    out: str | None,
    *,
    physics: str,
    ardurover: str | None,
    variant: str,
    seed: int,
    rover_file: str | None,
) -> tuple[tuple[Vehicle, Path], SessionFinished, Numbers | None]:
    """Drive the job on a simulated rover; (vehicle and its file, session, view of the true parameters)."""
    from rover_sweep.cli.driving.session_display import show_session
    from rover_sweep.cli.types.folders import session_folder
    from rover_sweep.session.session import drive
    from rover_sweep.session.simulated_rover import SimulatedRover, pilot, started
    from rover_sweep.vehicle.link.recorded_transport import RecordedLine, conversation_in

    simulation = SimulatedRover(
        "ardurover" if simulator == "ardurover" else "embedded",
        Path(ardurover) if ardurover else None,
        "own" if physics == "own" else "plant",
        variant,
        seed,
        prepared=False,
    )
    plan = _plan(job, simulation)
    text = None if rover_file else firmware_rover_text() if physics == "own" else rover_text(variant)
    folder = session_folder(out, "run", also=() if rover_file else ("rover.toml",))
    rover = vehicle_in(folder, rover_file, text)
    announce(plan, folder)
    with ExitStack() as stack:
        running = stack.enter_context(started(simulation, folder / "vehicle"))
        line = stack.enter_context(RecordedLine(conversation_in(folder)))
        answer = None
        if plan.settings.trigger == "pilot":
            follow = stack.enter_context(pilot(running, simulation.throttle_us))

            def answer(_: PlainDisplay, event: Event) -> None:
                follow(event)

        session = show_session(
            drive(running.connection, folder, plan, line), folder, go_on=True, answer=answer
        )
    return rover, session, None if physics == "own" else truth_view(variant)


def _plan(job: Job, simulation: SimulatedRover) -> SessionPlan:
    """The plan of the session; UsageError for values that the applet would refuse."""
    from firmware_params.applet_parameters import applet_path
    from firmware_params.param_files import read, shipped
    from rover_sweep.manoeuvre.applet_values import parameters_of
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.vehicle.run.settings import RunSettings

    trigger = job.trigger or "override"
    if trigger == "pilot" and simulation.simulator == "embedded":
        raise UsageError("the embedded rover has no radio for switch 6; use --throw-switch override or aux")
    highest = max(run.manoeuvre.peak for run in job.runs)
    extra = {"pwm_max": max(_PWM_MAX, highest), **_LIMITS, **job.limits}
    for run in job.runs:
        parameters_of(run.manoeuvre, **extra)
    throttle = None if trigger == "pilot" else simulation.throttle_us
    settings = RunSettings(True, throttle, trigger, extra)
    return SessionPlan(
        job.runs, settings, read(shipped("identification")), applet=applet_path(), logs=job.logs
    )
