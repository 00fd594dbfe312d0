"""`rover-sweep design`: check a sweep, doublet or multisine on paper before driving it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from rover_sweep.cli.options import NumberRange
from rover_sweep.cli.views.output import echo

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
POSITIVE = NumberRange(0, min_open=True)


@click.command()
@click.option(
    "--type",
    "kind",
    type=click.Choice(list(ONLY_FOR)),
    default="sweep",
    show_default=True,
    help="Kind of manoeuvre.",
)
@click.option("--amplitude", type=POSITIVE, default=150.0, show_default=True, help="Steering offset, us.")
@click.option("--wmin", type=POSITIVE, default=0.3, show_default=True, help="Sweep: lowest frequency, rad/s.")
@click.option(
    "--wmax", type=POSITIVE, default=25.0, show_default=True, help="Sweep: highest frequency, rad/s."
)
@click.option("--trec", type=POSITIVE, default=55.0, show_default=True, help="Sweep: duration T_rec, s.")
@click.option(
    "--fade", type=NumberRange(0), default=2.0, show_default=True, help="Sweep: fade in and out, s."
)
@click.option(
    "--dwell", type=NumberRange(0), default=2.0, show_default=True, help="Sweep: time at wmin before it, s."
)
@click.option(
    "--runs",
    type=click.IntRange(1, 20),
    default=2,
    show_default=True,
    help="Sweep: number of runs identified together.",
)
@click.option(
    "--periods", type=click.IntRange(2, 20), default=3, show_default=True, help="Multisine: periods in T_rec."
)
@click.option(
    "--bias", type=float, default=100.0, show_default=True, help="Bias sweep: mean steering offset, us."
)
@click.option(
    "--pulse", type=POSITIVE, default=1.0, show_default=True, help="Doublet: duration of a step, s."
)
@click.option(
    "--pause", type=NumberRange(0), default=2.0, show_default=True, help="Doublet: pause after each, s."
)
@click.option(
    "--count", type=click.IntRange(1, 50), default=2, show_default=True, help="Doublet: number of doublets."
)
@click.option(
    "--straight",
    type=NumberRange(0),
    default=3.0,
    show_default=True,
    help="Time without steering before and after, s.",
)
@click.option(
    "--vehicle",
    "vehicle_path",
    type=click.Path(dir_okay=False),
    help="Vehicle file; gives wheel angles and space needed.",
)
@click.option("--speed", type=POSITIVE, help="Speed, m/s; gives space needed and lateral acceleration.")
@click.option(
    "--servo", type=NumberRange(0.01, 2), help="Time of your servo for 60 deg, from its data sheet, s."
)
@click.option(
    "--loop-rate", type=NumberRange(10, 2000), default=50.0, show_default=True, help="SCHED_LOOP_RATE, Hz."
)
@click.option("--gyro-filter", type=POSITIVE, default=4.0, show_default=True, help="INS_GYRO_FILTER, Hz.")
@click.option("--accel-filter", type=POSITIVE, default=10.0, show_default=True, help="INS_ACCEL_FILTER, Hz.")
@click.option("--plot", type=click.Path(dir_okay=False), help="Write a picture (.png, .svg, .pdf).")
@click.option("--json", "as_json", is_flag=True, help="Print the numbers as JSON on stdout.")
@click.pass_context
def design(
    ctx: click.Context,
    vehicle_path: str | None,
    speed: float | None,
    servo: float | None,
    plot: str | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Check a manoeuvre on paper before driving it.

    Shows the demands on servo, space, tyres, loop rate, telemetry and filters, and what to change. The
    defaults are the paper's sweep and ArduRover's default settings.

    \b
    rover-sweep design --wmin .3 --wmax 25 --trec 55 --amplitude 150 --speed 2.5 --vehicle rover.toml
    """
    from rover_sweep.cli.views.design_summary import show_design, show_json
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.design.advice import refuse_nonsense, with_advice
    from rover_sweep.design.demand import make_design
    from rover_sweep.manoeuvre.sweep import parameters_of

    vehicle = load(vehicle_path) if vehicle_path else None
    if speed and vehicle:
        vehicle.steering()  # raises here if the file has no steering gain, before any computation
    manoeuvre = _manoeuvre(ctx, options)
    parameters_of(manoeuvre)  # raises for values that the applet would refuse
    planned = make_design(
        manoeuvre,
        vehicle,
        speed,
        options["runs"],
        options["loop_rate"],
        options["gyro_filter"],
        options["accel_filter"],
    )
    refuse_nonsense(planned)
    planned = with_advice(planned, servo)
    if plot:
        from rover_sweep.cli.views.design_summary import draw_design

        draw_design(planned, vehicle, Path(plot))
        echo(f"picture written to {plot}", err=True)
    if as_json:
        show_json(planned)
    else:
        show_design(planned, vehicle)
        _say_assumed(ctx)


def _say_assumed(ctx: click.Context) -> None:
    """Name the settings of the rover that were not given."""
    from rover_sweep.cli.views.display import fact

    assumed = [n for n in _SETTINGS if ctx.get_parameter_source(n) is ParameterSource.DEFAULT]
    if assumed:
        names, flags = (", ".join(_SETTINGS[n][k] for n in assumed) for k in (0, 1))
        echo("\n" + fact("assumed", f"ArduRover's defaults for {names}; give yours with {flags}"))


def _manoeuvre(ctx: click.Context, options: dict[str, Any]) -> Manoeuvre:
    from rover_sweep.manoeuvre.multisine import Multisine
    from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Sweep

    kind = options["kind"]
    for other, names in ONLY_FOR.items():
        for name in set(names) - set(ONLY_FOR[kind]):
            if ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE:
                raise click.UsageError(f"--{name} belongs to --type {other}, not to a {kind}", ctx)
    amplitude, straight = options["amplitude"], options["straight"]
    if kind == "doublet":
        return Doublet(amplitude, options["pulse"], options["pause"], options["count"], straight)
    if options["wmin"] >= options["wmax"]:
        raise click.UsageError(
            f"--wmin {options['wmin']:g} must lie below --wmax {options['wmax']:g} rad/s", ctx
        )
    band = amplitude, options["wmin"], options["wmax"], options["trec"]
    ends = {name: options[name] for name in ("fade", "dwell", "straight")}
    try:
        if kind == "multisine":
            return Multisine(*band, options["periods"], **ends)
    except ValueError as error:
        raise click.UsageError(str(error), ctx) from error
    if kind == "bias-sweep":
        return BiasSweep(*band, **ends, bias=options["bias"])
    return Sweep(*band, **ends)
