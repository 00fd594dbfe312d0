"""`run --vehicle embedded|ardurover`: the whole job on a simulated rover that is started for it.

It is as from the factory: applet and parameters are brought onto it as onto a real one. It is armed and
driven without a question, which is what a simulated rover is for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.driving.job import Job, announce
from rover_sweep.cli.driving.rover_numbers import (
    firmware_rover_text,
    own_numbers,
    rover_text,
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
_PWM_MAX = 250.0  # SWP_PWM_MAX as it comes
_DEFAULTS = {"physics": "plant", "variant": "nominal", "seed": 1}


def simulation_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """--physics, --ardurover, --variant, --seed and --rover-file, of a rover that is simulated."""
    for decorate in (
        click.option(
            "--rover-file",
            type=click.Path(dir_okay=False),
            metavar="FILE",
            help="Simulated: a vehicle file instead of the one that its physics make.",
        ),
        click.option(
            "--seed",
            type=click.IntRange(min=0),
            default=_DEFAULTS["seed"],
            help="Simulated: of noise and road. [default: 1]",
        ),
        click.option(
            "--variant",
            default=_DEFAULTS["variant"],
            metavar="NAME|FILE",
            help=f"Simulated: {', '.join(variants())}, or a TOML file. [default: nominal]",
        ),
        click.option(
            "--ardurover",
            type=click.Path(dir_okay=False),
            metavar="FILE",
            help="ArduRover's SITL program (else $ROVER_SWEEP_ARDUROVER, else the PATH).",
        ),
        click.option(
            "--physics",
            type=click.Choice(("plant", "own")),
            default=_DEFAULTS["physics"],
            help="Behind the firmware: our plant, or the firmware's own rover. [default: plant]",
        ),
    ):
        command = decorate(command)
    return command


def refuse_on_simulated(connect: str | None, arm: bool, throttle: int | None) -> None:
    """UsageError for what only makes sense on a rover that is there already."""
    if connect:
        raise UsageError("--vehicle embedded or ardurover starts a rover of its own; leave --connect out")
    if arm or throttle is not None:
        raise UsageError("a simulated rover is armed and driven anyway; leave --arm and --throttle out")


def refuse_without_simulation(connect: str | None, options: Mapping[str, Any]) -> None:
    """UsageError for options of a simulated rover where none is asked for, and for no rover at all."""
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
    """(vehicle file, session, what shows the rover's own numbers) after the job on a simulated rover."""
    from rover_sweep.cli.driving.shared import driven
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
            told = stack.enter_context(pilot(running, simulation.throttle_us))

            def answer(_: PlainDisplay, event: Event) -> None:
                told(event)

        session = driven(drive(running.connection, folder, plan, line), folder, go_on=True, answer=answer)
    return rover, session, None if physics == "own" else own_numbers(variant)


def _plan(job: Job, simulation: SimulatedRover) -> SessionPlan:
    """As a session; UsageError for what the applet would refuse."""
    from firmware_params.applet_parameters import applet_path
    from firmware_params.param_files import read, shipped
    from rover_sweep.manoeuvre.applet_values import parameters_of
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.vehicle.run.settings import RunSettings

    trigger = job.trigger or "override"
    if trigger == "pilot" and simulation.simulator == "embedded":
        raise UsageError("the embedded rover has no stick to throw switch 6; take override or aux")
    highest = max(run.manoeuvre.peak for run in job.runs)
    extra = {"pwm_max": max(_PWM_MAX, highest), **_LIMITS, **job.limits}
    for run in job.runs:
        parameters_of(run.manoeuvre, **extra)
    throttle = None if trigger == "pilot" else simulation.throttle_us
    settings = RunSettings(True, throttle, trigger, extra)
    return SessionPlan(
        job.runs, settings, read(shipped("identification")), applet=applet_path(), logs=job.logs
    )
