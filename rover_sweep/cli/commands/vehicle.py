"""`rover-sweep vehicle`: print an example vehicle file, or check a file."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import get_args

import click

from rover_sweep.cli.options import FILE, argument, option, options
from rover_sweep.cli.views.output import echo, echo_json, print_table, results, say_next
from rover_sweep.data.plausibility import implausible
from rover_sweep.data.vehicle_file import Measured, Model, Vehicle, example, load
from rover_sweep.data.vehicle_geometry import SIZED, geometry_of, with_uncertainties
from rover_sweep.data.vehicle_rules import KEYS, MATERIAL
from rover_sweep.errors import UsageError


class _VehicleGroup(click.Group):
    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command; a file in its place is a usage error that names `check`."""
        if args[0] not in self.commands and Path(args[0]).is_file():
            raise click.UsageError(f"to check a file, use: rover-sweep vehicle check {args[0]}", ctx)
        return super().resolve_command(ctx, args)


@click.group(cls=_VehicleGroup, invoke_without_command=True)
@click.option("--example", "show_example", is_flag=True, help="Print a commented example file and exit.")
@click.pass_context
def vehicle(ctx: click.Context, show_example: bool) -> None:
    """Print an example of the vehicle file rover.toml, or check yours.

    Create one with: rover-sweep vehicle --example > rover.toml
    """
    if show_example:
        echo(example(), nl=False)
        say_next("weigh, measure and edit it in a file", "rover-sweep vehicle check rover.toml")
        ctx.exit()
    if ctx.invoked_subcommand is None:
        echo(ctx.get_help())


@vehicle.command(short_help="Check FILE and show which models it is sufficient for.")
@options
def check(
    file: str = argument(type=FILE),
    as_json: bool = option("Print the numbers as JSON on stdout.", flag="--json"),
) -> None:
    """Read FILE, show its values, their standard deviations and the models for which they are sufficient.

    Reports all problems at once, implausible values too; exit code 2 if there are any.
    """
    found = load(file)
    if odd := implausible(geometry_of(found)):
        raise UsageError(f"{file}: {odd[0]}")
    found = with_uncertainties(found)
    if as_json:
        models = {model: not found.missing_for(model) for model in get_args(Model)}
        echo_json(json.dumps(asdict(found) | {"wheelbase": found.wheelbase, "models": models}, indent=2))
        return
    _show(found, file)


def _show(found: Vehicle, file: str) -> None:
    console, rows = results(), []
    numbers = [(k.partition(".")[2], rule.unit, rule.meaning) for k, rule in KEYS.items()]
    for name, unit, meaning in numbers:
        number = getattr(found, name)
        free = " [free]" if name in found.free else ""
        rows.append((name, "-" if number is None else str(number), unit, _source(number), meaning + free))
    rows.append(("wheelbase", f"{found.wheelbase:g}", "m", "", "a + b"))
    for axis, number in zip(("forward", "right", "down"), found.imu_position or (None,) * 3, strict=True):
        rows.append((f"imu {axis}", str(number or "-"), "m", _source(number), f"IMU {axis} of the sprung CG"))
    console.print(f"{file}: {found.name or 'no name'}", style="bold")
    print_table(console, ("key", "value", "unit", "sd from", "meaning"), rows, text_columns=(0, 2, 3, 4))
    console.print()
    for model in get_args(Model):
        missing = found.missing_for(model)
        console.print(f"{model}: " + (f"also needs {', '.join(missing)}" if missing else "sufficient"))
    shown = {*SIZED.values(), "imu_position"}  # with the numbers above
    sizes = [
        f"{k} {size:g} {MATERIAL[k].unit}".rstrip(" -")
        for k, size in found.material.items()
        if k not in shown
    ]
    if sizes:
        console.print(f"diagnose ignores effects smaller than: {', '.join(sizes)}")
    if found.rad_per_us is None:
        words = "a PWM cannot be converted to a road-wheel angle (a measured angle can be used)"
        console.print(f"no [steering]: {words}")
    if found.imu_position is None:
        words = "the IMU is assumed at the CG; if it is elsewhere, a_y has an error"
        console.print(f"no [imu] position: {words}")
    say_next(f"rover-sweep design --vehicle {file} --speed 2", "rover-sweep preflight --connect URL")


def _source(number: Measured | None) -> str:
    """Where the standard deviation comes from."""
    return "" if number is None or number.sd is None else number.how or "written"
