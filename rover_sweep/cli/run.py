"""`rover-sweep run`: the sweeps on a real rover, watched, recorded, judged and identified."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rover_sweep.cli.manoeuvres import LimitType, ManoeuvreType
from rover_sweep.cli.options import output_options, vehicle_path
from rover_sweep.identify.multisine import Multisine
from rover_sweep.identify.sweep import BiasSweep, Doublet, Sweep

if TYPE_CHECKING:
    from collections.abc import Callable

    from rover_sweep.cli.display import PlainDisplay
    from rover_sweep.vehicle.events import Event
    from rover_sweep.vehicle.run import RunSettings
    from rover_sweep.vehicle.session import Plan, PlannedRun

_PILOT_PATIENCE = 900.0  # s for the pilot to arm, to throw the switch, to disarm at the end


@click.command()
@click.option("--connect", required=True, metavar="URL",
              help="tcp:HOST:PORT, udp:HOST:PORT (listen), or /dev/ttyACM0,115200.")  # fmt: skip
@click.option("--vehicle", "vehicle_file", type=click.Path(dir_okay=False), metavar="FILE",
              help="Vehicle file (default: rover.toml here).")  # fmt: skip
@click.option("--sweep", "sweeps", type=ManoeuvreType(Sweep), multiple=True,
              help="In us, rad/s, s; or by name, e.g. 150,wmax=20. May be repeated.")  # fmt: skip
@click.option("--doublet", "doublets", type=ManoeuvreType(Doublet), multiple=True,
              help="In us and s; the models are verified on it. May be repeated.")  # fmt: skip
@click.option("--multisine", "multisines", type=ManoeuvreType(Multisine), multiple=True,
              help="Peak in us, rad/s, s; shows 2nd and 3rd harmonics at once. May be repeated.")  # fmt: skip
@click.option("--bias-sweep", "bias_sweeps", type=ManoeuvreType(BiasSweep), multiple=True,
              help="A sweep about a steering offset in us, e.g. 80,100. May be repeated.")  # fmt: skip
@click.option("--limit", "limits", type=LimitType(), multiple=True,
              help="A limit of the applet, e.g. v_max=3; the rover's own if not said.")  # fmt: skip
@click.option("--arm", is_flag=True, help="Let this program arm and disarm the rover.")
@click.option("--throttle", type=click.IntRange(1000, 2000), metavar="US",
              help="With --arm: let this program drive, with this throttle PWM.")  # fmt: skip
@click.option("--throw-switch", is_flag=True, help="Let this program throw the applet's switch.")
@click.option("--no-log", is_flag=True,
              help="Leave the rover's log on its card; identify from telemetry.")  # fmt: skip
@click.option("--out", type=click.Path(file_okay=False), metavar="DIR",
              help="Folder for recordings and report. [default: run, else run-2, ...]")  # fmt: skip
@output_options
def run(
    connect: str, vehicle_file: str | None, sweeps: tuple[Sweep, ...], doublets: tuple[Doublet, ...],
    multisines: tuple[Multisine, ...], bias_sweeps: tuple[BiasSweep, ...],
    limits: tuple[tuple[str, float], ...], arm: bool, throttle: int | None, throw_switch: bool, no_log: bool,
    out: str | None, as_json: bool, verbose: bool,
) -> None:  # fmt: skip
    """Drive sweeps and doublets on a rover, record them, say whether they are good, and identify from them.

    The pilot arms, drives and throws the switch (RC6_OPTION 300); this program sets the applet's
    parameters, records, and moves nothing unless --arm, --throttle or --throw-switch say so. Switch low
    ends a run at once, without the laptop; Ctrl-C does too, and goes on to log and report with the runs
    that are whole. Without any manoeuvre: two sweeps and a doublet of 150 us.

    \b
    rover-sweep run --connect /dev/ttyUSB0,57600 --vehicle rover.toml \\
      --sweep 120 --sweep 200,wmax=20 --doublet 150 --out today
    """
    from firmware_params.check import read, shipped
    from rover_sweep.cli.folders import session_folder
    from rover_sweep.cli.session import driven, identified_session
    from rover_sweep.vehicle.manoeuvre import parameters_of
    from rover_sweep.vehicle.run import RunSettings
    from rover_sweep.vehicle.session import Plan, drive
    from rover_sweep.vehicle.transport import parse_url
    from rover_sweep.vehicle_file import load

    path = Path(vehicle_path(vehicle_file))
    vehicle = load(path)
    vehicle.steering()  # refuses in words what could only fail after the drive; so do the next two
    parse_url(connect)
    extra = ({"gcs": 1.0} if throttle is not None else {}) | dict(limits)
    settings = RunSettings(
        arm, throttle, "override" if throw_switch else "pilot", extra, patience=_PILOT_PATIENCE
    )
    runs = _planned(sweeps, multisines, bias_sweeps, doublets)
    plan = Plan(runs, settings, checked=read(shipped("identification")), logs=not no_log)
    for planned in plan.runs:
        parameters_of(planned.manoeuvre, **extra)
    folder = session_folder(out, "run")
    _announce(plan, folder)
    session = driven(drive(connect, folder, plan), folder, talk=True, go_on=True, answer=_asking(settings))
    identified_session(session, (vehicle, path), as_json, verbose)


def _planned(
    sweeps: tuple[Sweep, ...],
    multisines: tuple[Multisine, ...],
    bias_sweeps: tuple[BiasSweep, ...],
    doublets: tuple[Doublet, ...],
) -> tuple[PlannedRun, ...]:
    """Named runs in the order in which they are driven; two sweeps and a doublet if there are none."""
    from rover_sweep.vehicle.session import PlannedRun

    if not (sweeps or multisines or bias_sweeps or doublets):
        sweeps, doublets = (Sweep(), Sweep()), (Doublet(),)
    return (
        *(PlannedRun(f"sweep{n}", sweep) for n, sweep in enumerate(sweeps, 1)),
        *(PlannedRun(f"multisine{n}", multisine) for n, multisine in enumerate(multisines, 1)),
        *(PlannedRun(f"bias-sweep{n}", sweep) for n, sweep in enumerate(bias_sweeps, 1)),
        *(PlannedRun(f"doublet{n}" if n > 1 else "doublet", d) for n, d in enumerate(doublets, 1)),
    )


def _announce(plan: Plan, folder: Path) -> None:
    """Who moves what, before anything is connected."""
    from rover_sweep.cli.output import narration

    own = [
        words
        for told, words in (
            (plan.settings.arm, "arms the rover"),
            (plan.settings.throttle_us is not None, f"drives with throttle {plan.settings.throttle_us} us"),
            (plan.settings.trigger == "override", "throws the switch"),
        )
        if told
    ]
    words = f"this program {', '.join(own)}" if own else "arming, driving and the switch are the pilot's"
    seconds = sum(planned.manoeuvre.duration for planned in plan.runs)
    console = narration()
    console.print(
        f"{len(plan.runs)} runs, {seconds:.0f} s of steering in all, into {folder}; {words}",
        markup=False, soft_wrap=True,
    )  # fmt: skip


def _asking(settings: RunSettings) -> Callable[[PlainDisplay, Event], None]:
    """Where this program arms and somebody sits at the terminal: a question before each run."""
    from rover_sweep.vehicle.events import RunStarted

    def answer(display: PlainDisplay, event: Event) -> None:
        if isinstance(event, RunStarted) and settings.arm and sys.stdin.isatty():
            display.ask(f"{event.name} arms the rover: is the ground free? Enter starts it, Ctrl-C ends")

    return answer
