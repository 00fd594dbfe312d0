"""`rover-sweep design`: check a sweep, doublet or multisine on paper before driving it."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from rover_sweep.cli.options import FILE, POSITIVE, NumberRange, option, options
from rover_sweep.cli.views.output import echo, echo_json, say_next

if TYPE_CHECKING:
    from rover_sweep.manoeuvre.sweep import Manoeuvre

_SWEPT = ("wmin", "wmax", "trec", "fade", "dwell", "runs")
ONLY_FOR = {
    "sweep": _SWEPT,
    "doublet": ("pulse", "pause", "count"),
    "multisine": (*_SWEPT, "periods"),
    "bias-sweep": (*_SWEPT, "bias"),
}
_SETTINGS = {  # option: (the rover's parameter, flag)
    "loop_rate": ("SCHED_LOOP_RATE", "--loop-rate"),
    "gyro_filter": ("INS_GYRO_FILTER", "--gyro-filter"),
    "accel_filter": ("INS_ACCEL_FILTER", "--accel-filter"),
}


@click.command()
@options
def design(
    type: str = option("Kind of manoeuvre.", click.Choice(list(ONLY_FOR)), default="sweep"),
    amplitude: float = option("Steering offset, us.", POSITIVE, default=150.0),
    wmin: float = option("Sweep: lowest frequency, rad/s.", POSITIVE, default=0.3),
    wmax: float = option("Sweep: highest frequency, rad/s.", POSITIVE, default=25.0),
    trec: float = option("Sweep: duration T_rec, s.", POSITIVE, default=55.0),
    fade: float = option("Sweep: fade in and out, s.", NumberRange(0), default=2.0),
    dwell: float = option("Sweep: time at wmin before it, s.", NumberRange(0), default=2.0),
    runs: int = option("Sweep: number of runs identified together.", click.IntRange(1, 20), default=2),
    periods: int = option("Multisine: periods in T_rec.", click.IntRange(2, 20), default=3),
    bias: float = option("Bias sweep: mean steering offset, us.", float, default=100.0),
    pulse: float = option("Doublet: duration of a step, s.", POSITIVE, default=1.0),
    pause: float = option("Doublet: pause after each, s.", NumberRange(0), default=2.0),
    count: int = option("Doublet: number of doublets.", click.IntRange(1, 50), default=2),
    straight: float = option("Time without steering before and after, s.", NumberRange(0), default=3.0),
    vehicle: str | None = option("Vehicle file; gives wheel angles and space needed.", FILE),
    speed: float | None = option("Speed, m/s; gives space needed and lateral acceleration.", POSITIVE),
    servo: float | None = option(
        "Time of your servo for 60 deg, from its data sheet, s.", NumberRange(0.01, 2)
    ),
    loop_rate: float = option("SCHED_LOOP_RATE, Hz.", NumberRange(10, 2000), default=50.0),
    gyro_filter: float = option("INS_GYRO_FILTER, Hz.", POSITIVE, default=4.0),
    accel_filter: float = option("INS_ACCEL_FILTER, Hz.", POSITIVE, default=10.0),
    plot: str | None = option("Write a picture (.png, .svg, .pdf).", FILE),
    as_json: bool = option("Print the numbers as JSON on stdout.", flag="--json"),
) -> None:
    """Check a manoeuvre on paper before driving it.

    Shows the demands on servo, space, tyres, loop rate, telemetry and filters, and what to change. The
    defaults are the paper's sweep and ArduRover's default settings.

    \b
    rover-sweep design --wmin .3 --wmax 25 --trec 55 --amplitude 150 --speed 2.5 --vehicle rover.toml
    """
    from rover_sweep.cli.views.design_summary import draw_design, show_design
    from rover_sweep.cli.views.display import fact
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.design.advice import refuse_nonsense, with_advice
    from rover_sweep.design.demand import make_design
    from rover_sweep.manoeuvre.multisine import Multisine
    from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Sweep, parameters_of

    rover = load(vehicle) if vehicle else None
    if speed and rover:
        rover.steering()  # raises here if the file has no steering gain, before any computation
    ctx = click.get_current_context()
    for other, names_of in ONLY_FOR.items():
        for name in set(names_of) - set(ONLY_FOR[type]):
            if ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE:
                raise click.UsageError(f"--{name} belongs to --type {other}, not to a {type}", ctx)
    ends: dict[str, Any] = {"fade": fade, "dwell": dwell, "straight": straight}
    manoeuvre: Manoeuvre
    if type == "doublet":
        manoeuvre = Doublet(amplitude, pulse, pause, count, straight)
    elif wmin >= wmax:
        raise click.UsageError(f"--wmin {wmin:g} must lie below --wmax {wmax:g} rad/s", ctx)
    elif type == "multisine":
        try:
            manoeuvre = Multisine(amplitude, wmin, wmax, trec, periods, **ends)
        except ValueError as error:
            raise click.UsageError(str(error), ctx) from error
    elif type == "bias-sweep":
        manoeuvre = BiasSweep(amplitude, wmin, wmax, trec, **ends, bias=bias)
    else:
        manoeuvre = Sweep(amplitude, wmin, wmax, trec, **ends)
    parameters_of(manoeuvre)  # raises for values that the applet would refuse
    planned = make_design(manoeuvre, rover, speed, runs, loop_rate, gyro_filter, accel_filter)
    refuse_nonsense(planned)
    planned = with_advice(planned, servo)
    if plot:
        draw_design(planned, rover, Path(plot))
        echo(f"picture written to {plot}", err=True)
    if as_json:
        echo_json(json.dumps(asdict(planned), indent=2))  # units as in the docstrings of Design
    else:
        show_design(planned, rover)
        assumed = [n for n in _SETTINGS if ctx.get_parameter_source(n) is ParameterSource.DEFAULT]
        if assumed:
            names, flags = (", ".join(_SETTINGS[n][k] for n in assumed) for k in (0, 1))
            echo("\n" + fact("assumed", f"ArduRover's defaults for {names}; give yours with {flags}"))
        values = f"{amplitude:g},{bias:g}" if type == "bias-sweep" else f"{amplitude:g}"
        say_next(f"rover-sweep run --connect URL --vehicle {vehicle or 'rover.toml'} --{type} {values}")
