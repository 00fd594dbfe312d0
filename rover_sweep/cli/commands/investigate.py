"""`rover-sweep investigate`: drive, diagnose, and choose the next run until the missing effect is settled."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.driving_options import DRIVEN_SIMULATION, NO_LOG, PHYSICS, Permissions, SimulationOptions
from rover_sweep.cli.options import (
    EFFECTS,
    FILE,
    FOLDER,
    GROUND,
    READING,
    NumberRange,
    Parsed,
    argument,
    gathered,
    option,
    options,
    vehicle_path,
)
from rover_sweep.cli.vehicle_link import ACCESS, MAYBE_CONNECT
from rover_sweep.cli.views.output import echo_json, say_next
from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.api.read import Reading
    from rover_sweep.diagnosis.plans.planner import PlannedRun
    from rover_sweep.session.simulated_rover import Physics
    from rover_sweep.vehicle.link.connection import Access

ABOVE_LEAST = 1.2  # a run is so much faster than the least speed of the applet
_ALLOWED = gathered(
    Permissions,
    throttle=option(
        "With --arm: allow this program to drive, with at most this throttle PWM.",
        click.IntRange(1000, 2000),
        "US",
    ),
)


@click.command()
@options
def investigate(
    recorded: tuple[str, ...] = argument("[RUN]...", nargs=-1),
    connect: str | None = MAYBE_CONNECT,
    access: Access = ACCESS,
    vehicle: str | None = option(
        "Vehicle file. [default: the session's, or rover.toml here; of a simulated rover, its true numbers]",
        FILE,
    ),
    runs: int = option("Most runs.", click.IntRange(1, 50), default=6),
    speed: float = option(
        "Largest speed; with --throttle, the speed at that throttle.",
        NumberRange(0.3, 30),
        "M/S",
        default=2.4,
    ),
    amplitude: float | None = option("Largest steering offset.", NumberRange(20, 500), "US"),
    ground: tuple[float, float] | None = option("Length and width in m; larger runs are not chosen.", GROUND),
    battery: float = option(
        "Drive no further run below this charge, if the rover reports it.",
        NumberRange(0, 100),
        "PERCENT",
        default=20.0,
    ),
    allowed: Permissions = _ALLOWED,
    no_log: bool = NO_LOG,
    simulation: SimulationOptions = DRIVEN_SIMULATION,
    physics: Physics = PHYSICS,
    out: str | None = option("Folder; that of an earlier call is continued.", FOLDER),
    as_json: bool = option("Print investigation.json on stdout.", flag="--json"),
) -> None:
    """Drive the smallest first set, diagnose, choose the run that best decides the open effects, and repeat.

    It ends when the effect is settled, or when runs, ground or battery are used up. Each choice is shown with
    its reason. Before each run it waits for a y at the terminal; Ctrl-C stops the rover and keeps the runs.
    The permissions to arm, drive and throw the switch are those of `run`.

    \b
    rover-sweep investigate --connect URL --vehicle rover.toml --out today
    rover-sweep investigate today            shows the next step only, and drives nothing
    """
    from rover_sweep.api.investigation import Bounds
    from rover_sweep.cli.driving import driven, investigating

    applet = dict(allowed.limit)
    largest = min((v for v in (amplitude, applet.get("pwm_max")) if v is not None), default=None)
    slowest = ABOVE_LEAST * applet.get("v_min", 0.0)
    bounds = Bounds(runs, speed, largest, ground, slowest=slowest)
    if recorded and (connect or simulation.simulator):
        raise UsageError(
            f"{recorded[0]} is a recorded run; leave it out to drive (--out continues a session), or leave "
            "out --connect to see the next step"
        )
    if simulation.simulator:
        driven.refuse_on_simulated(connect, allowed)
        investigating.investigate_simulated(
            simulation, physics, vehicle, bounds, applet, not no_log, out, as_json
        )
    elif connect:
        driven.refuse_without_simulation(connect, simulation, physics)
        investigating.investigate_rover(
            connect, access, vehicle, bounds, allowed, battery / 100, not no_log, out, as_json
        )
    elif recorded:
        investigating.show_next_step(recorded, vehicle, bounds, out, as_json)
    else:
        raise UsageError("no rover: give --connect URL, --simulator embedded or ardurover, or recorded runs")


_NUMBER = r"[0-9]+\.?[0-9]*"
MOST_US, MOST_SPEED = 500, 30  # us from trim and m/s: limits of the servo output and of the applet
_RUN = re.compile(rf"({_NUMBER})(?:([+-]{_NUMBER}))?@({_NUMBER})(?:@(-?{_NUMBER}))?")


def _planned_type(kind: Any) -> Parsed:
    """A run as AMPLITUDE@SPEED in us and m/s; with a heading in deg 150@2.4@90; with a bias 100+150@2.4."""
    biased = kind == "bias_sweep"

    def planned(text: str) -> PlannedRun:
        from rover_sweep.diagnosis.plans.planner import PlannedRun

        text = text.strip()
        found = _RUN.fullmatch(text)
        if not found or (found[2] is not None) != biased:
            raise ValueError(_mistake(text, biased))
        amplitude, bias, speed = float(found[1]), float(found[2] or 0.0), float(found[3])
        if not (amplitude >= 1 and amplitude + abs(bias) <= MOST_US and 0 < speed <= MOST_SPEED):
            peak = ", bias included" if biased else ""
            raise ValueError(
                f"{text!r}: an amplitude is 1..{MOST_US} us{peak} and a speed up to {MOST_SPEED} m/s"
            )
        return PlannedRun(kind, amplitude, speed, float(found[4]) % 360.0 if found[4] else None, bias)

    return Parsed(f"AMPLITUDE{'+BIAS' if biased else ''}@SPEED", planned)


def _mistake(text: str, biased: bool) -> str:
    """The mistake in a run's text, and the correct form."""
    written = f"write it as {'100+150@2.4' if biased else '150@2.4'}, us and m/s (@90 for a heading)"
    if re.fullmatch(rf"{_NUMBER}([+-]{_NUMBER})?", text):
        return f"{text!r} has no speed; {written}"
    if text.startswith("-"):
        return f"{text!r} has a negative amplitude; give the peak, which is positive; {written}"
    if "," in text:
        return f"{text!r} has a decimal comma; {written}"
    if biased and "@" in text and not re.search(r"[0-9][+-][0-9]", text):
        return f"{text!r} has no bias; {written}"
    if not biased and re.match(rf"{_NUMBER}[+-]", text):
        return f"{text!r} has a bias, which only --bias-sweep takes; {written}"
    return f"{text!r} is not a run; {written}"


def _run_option(kind: str, words: str) -> Any:
    return option(f"{words}; may be repeated.", _planned_type(kind), multiple=True)


@click.command()
@options
def plan(
    vehicle: str | None = option("Vehicle file (default: rover.toml here).", FILE),
    have: tuple[str, ...] = option("A run already driven; may be repeated.", None, "RUN", multiple=True),
    sweep: tuple[PlannedRun, ...] = _run_option("sweep", "Sweep with this peak (us) and speed (m/s)"),
    doublet: tuple[PlannedRun, ...] = _run_option("doublet", "Doublet"),
    bias_sweep: tuple[PlannedRun, ...] = _run_option(
        "bias_sweep", "Sweep about a steering bias, as 100+150@2.4"
    ),
    multisine: tuple[PlannedRun, ...] = _run_option("multisine", "Odd/even multisine, which shows harmonics"),
    servo_test: tuple[float, ...] = option(
        "Sweep of this peak on blocks with the wheel angle measured.",
        NumberRange(1, MOST_US),
        "US",
        multiple=True,
    ),
    want: tuple[str, ...] = option("Only these effects must be detected and separated.", EFFECTS, default=()),
    reading: Reading = READING,
    as_json: bool = option("Print the plan as JSON on stdout.", flag="--json"),
) -> None:
    """Show which effects a set of runs can separate, and propose the most informative runs.

    \b
    rover-sweep plan --vehicle rover.toml --sweep 120@2.4 --sweep 240@2.4 --doublet 150@2.4
    rover-sweep plan --vehicle rover.toml --have run1.BIN --have run2.BIN --want tyre_saturation,load_transfer

    Equal runs count as repeats. Without any run, a first set is proposed. An effect counts as separated where
    a diagnosis is expected to name it, with 80 %.
    """
    from rover_sweep.api.diagnosis_input import effects_named
    from rover_sweep.api.investigation import as_planned, merged, plan_runs
    from rover_sweep.api.read import load_steered, refuse_overlap
    from rover_sweep.cli.views.asking import long_work
    from rover_sweep.cli.views.output import narration, print_warnings, results
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.diagnosis.plans.planner import PlannedRun
    from rover_sweep.report.diagnosis.report import plan_document, plan_report
    from rover_sweep.report.on_terminal import WIDTH, on_terminal
    from rover_sweep.report.wording import strict_json

    wanted = effects_named(want)
    rover = load(Path(vehicle_path(vehicle, have)))
    rover.steering()  # raises here if the file has no steering gain, before anything is read
    driven = load_steered(have, rover, reading) if have else ()
    print_warnings(narration(), driven)
    refuse_overlap(driven, ())
    blocks = [PlannedRun("servo_test", amplitude, 0.0) for amplitude in servo_test]
    runs = merged(
        [*(as_planned(run, rover) for run in driven), *sweep, *doublet, *bias_sweep, *multisine, *blocks]
    )
    with long_work("computing which effects these runs separate") as report:
        found = plan_runs(runs, rover, wanted, driven, report)
    if as_json:
        echo_json(strict_json(plan_document(found)))
        return
    console = results()
    console.print(on_terminal(plan_report(found)), width=min(console.width, WIDTH))
    to_drive = [_option(run) for run in found.proposal or found.runs if run.kind in _DRIVEN]
    if to_drive:
        say_next(f"rover-sweep run --connect URL --vehicle rover.toml {' '.join(to_drive)} (at these speeds)")


_DRIVEN = ("sweep", "doublet", "bias_sweep", "multisine")


def _option(run: PlannedRun) -> str:
    """The option of `run` for a planned run."""
    values = f"{run.amplitude_us:g}" + (f",{run.bias_us:g}" if run.bias_us else "")
    return " ".join([f"--{run.kind.replace('_', '-')} {values}"] * run.repeat)
