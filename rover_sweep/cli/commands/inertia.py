"""`rover-sweep inertia`: the swing test, equations (1) and (2) of the paper."""

from __future__ import annotations

import json
from dataclasses import asdict

import click

from rover_sweep.bench.swing_test import (
    AXES,
    CAVEATS,
    KEY,
    Axis,
    GravityCheck,
    Inertia,
    Swings,
    SwingTest,
    gravity_check,
    moment_of_inertia,
    remarks,
    rounded,
)
from rover_sweep.cli.types.options import NumberRange
from rover_sweep.cli.types.uncertain_number import MeasuredType, TimesType
from rover_sweep.cli.views.output import echo, echo_json
from rover_sweep.cli.views.paragraphs import bullet
from rover_sweep.data.vehicle_file import Measured, Vehicle, load, set_number
from rover_sweep.errors import DataRefused, UsageError

MASS = MeasuredType(0.05, 5000, "kg", "give kilograms")
LEAST_GYRATION = 0.1  # of the wheelbase: about the roll axis of a narrow rover it may be as little
LENGTH = MeasuredType(0.05, 20, "m", "give metres")


@click.command()
@click.option(
    "--axis",
    type=click.Choice(["yaw", "roll"]),
    default="yaw",
    show_default=True,
    help="Which axis hung vertical.",
)
@click.option(
    "--mass", type=MASS, help="Mass hung, kg. [default for yaw: mass of the file of --vehicle or --write]"
)
@click.option("--length", type=LENGTH, required=True, help="h, length of the wires from clamp to clamp, m.")
@click.option("--spacing", type=LENGTH, required=True, help="d, distance between the two wires, m.")
@click.option(
    "--times", type=TimesType(), required=True, help="Times of the turning swing, each for --swings swings."
)
@click.option(
    "--swings",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    help="Full swings, there and back, in each time.",
)
@click.option(
    "--check-times", type=TimesType(), help="Times of the swing to and fro in the plane of the wires."
)
@click.option(
    "--check-swings", type=click.IntRange(1), help="Full swings in each of them. [default: --swings]"
)
@click.option("--rig-mass", type=MASS, help="Mass of a board or cradle that carried the rover, kg.")
@click.option("--rig-times", type=TimesType(), help="Times of the rig swung alone, each for --swings swings.")
@click.option(
    "--timer-sd",
    type=NumberRange(0, 5),
    default=0.2,
    show_default=True,
    help="Uncertainty of one timing, s; 0.2 by hand.",
)
@click.option(
    "--vehicle",
    "vehicle_path",
    type=click.Path(dir_okay=False),
    help="Vehicle file to take the mass from and compare with.",
)
@click.option(
    "--write", type=click.Path(dir_okay=False), help="Vehicle file to write the result into; comments stay."
)
@click.option("--force", is_flag=True, help="With --write: write a test that is not good, too.")
@click.option("--json", "as_json", is_flag=True, help="The numbers as JSON on stdout.")
def inertia(
    axis: Axis,
    mass: Measured | None,
    length: Measured,
    spacing: Measured,
    times: tuple[float, ...],
    swings: int,
    check_times: tuple[float, ...] | None,
    check_swings: int | None,
    rig_mass: Measured | None,
    rig_times: tuple[float, ...] | None,
    timer_sd: float,
    vehicle_path: str | None,
    write: str | None,
    force: bool,
    as_json: bool,
) -> None:
    """Moment of inertia from a swing test.

    Hang the rover on two parallel vertical wires of the same length, one on either side of its CG. First
    swing it to and fro in the plane of the wires: that must give 9.81 m/s^2 (--check-times). Then turn it
    by a few degrees about the vertical, let go, and time the swings (--times). Numbers may carry their
    uncertainty, as in --length 1.200+-0.003.

    \b
    rover-sweep inertia --mass 2.66+-0.005 --length 1.200+-0.003 --spacing 0.300+-0.001 \\
      --swings 20 --times 47.5,47.3,47.6 --check-times 43.9,44.1 --write rover.toml
    """
    file = vehicle_path or write
    rover = load(file) if file else None
    hung = _mass(axis, mass, rover)
    if (rig_mass is None) != (rig_times is None):
        raise click.UsageError("--rig-mass and --rig-times go together")
    rig_period = Swings(rig_times, swings, timer_sd).period if rig_times else None
    test = SwingTest(hung, length, spacing, Swings(times, swings, timer_sd).period, rig_mass, rig_period)
    result = moment_of_inertia(test)
    if result.moment.value <= 0:
        raise UsageError(
            "the rig alone comes out with more inertia than rover and rig together "
            f"({result.moment.value:.3g} kg m^2 is left): are --times and --rig-times exchanged?"
        )
    swing = Swings(check_times, check_swings or swings, timer_sd).period if check_times else None
    check = gravity_check(length, swing) if swing else None
    gyration = _gyration(result, rover)
    said = (
        remarks(test, result, check, swing) + _against(axis, hung, rover) + ([gyration] if gyration else [])
    )
    if as_json:
        _print_json(axis, test, result, check, said)
    else:
        _print(axis, test, result, check, said, len(times), swings)
    if write:
        faults = _faults(check, gyration)
        if faults and not force:
            raise DataRefused(
                f"not written into {write}: {'; '.join(faults)}; swing again (--force writes it)"
            )
        set_number(write, KEY[axis], rounded(result.moment))
        echo(
            f"{KEY[axis].partition('.')[2]} = {rounded(result.moment)} kg m^2 written into {write}", err=True
        )


def _mass(axis: Axis, mass: Measured | None, rover: Vehicle | None) -> Measured:
    if mass is not None:
        return mass
    if axis == "roll":
        raise click.UsageError(
            "--mass is missing: for the roll axis say what hung there, "
            "at best the chassis without wheels and axles"
        )
    if rover is None:
        raise click.UsageError("--mass is missing, and no --vehicle file was given to take it from")
    return rover.mass


def _against(axis: Axis, hung: Measured, rover: Vehicle | None) -> list[str]:
    """What the vehicle file says to it."""
    whole_body = (
        "roll_inertia is that of the sprung mass about its own CG: swing the chassis without wheels and "
        "axles, or take this as an upper bound"
    )
    if rover is None:
        return [f"{whole_body} if the whole vehicle hung there"] if axis == "roll" else []
    said = []
    expected = rover.mass if axis == "yaw" else rover.sprung_mass
    if expected and abs(hung.value / expected.value - 1) > 0.02:
        what = "mass" if axis == "yaw" else "sprung_mass"
        said.append(f"{hung.value:g} kg hung there, but the vehicle file says {what} = {expected.value:g} kg")
        if axis == "roll":
            said.append(whole_body)
    return said


def _gyration(result: Inertia, rover: Vehicle | None) -> str:
    """What is wrong with the radius of gyration beside the wheelbase, '' if nothing or not known."""
    if rover is None:
        return ""
    share = result.radius_of_gyration / rover.wheelbase
    if LEAST_GYRATION <= share <= 1:
        return ""
    return (
        f"a radius of gyration of {result.radius_of_gyration:.2g} m is {share:.2g} times the wheelbase of "
        f"{rover.wheelbase:.3g} m, and {LEAST_GYRATION:g} to 1 is possible: check the units, the number of "
        "swings, and which period is which"
    )


def _faults(check: GravityCheck | None, gyration: str) -> list[str]:
    """Why a test is no measurement, in words; empty if nothing speaks against it."""
    failed = check is not None and not check.passed
    words = f"g comes out {check.percent:+.1f} % off" if check is not None and failed else ""
    return [fault for fault in (words, gyration) if fault]


def _print(
    axis: Axis,
    test: SwingTest,
    result: Inertia,
    check: GravityCheck | None,
    said: list[str],
    times: int,
    swings: int,
) -> None:
    moment = rounded(result.moment)
    percent = 100 * (result.moment.sd or 0.0) / result.moment.value
    echo(f"Swing test, {axis} axis: {AXES[axis]}\n")
    if check is not None:
        verdict = "fine" if check.passed else "NOT GOOD"
        echo(f"  g, equation (1)      {rounded(check.gravity)} m/s^2, {check.percent:+.1f} %: {verdict}")
    echo(f"  period               {rounded(test.period)} s ({times} x {swings} swings)")
    echo(f"  inertia, eq. (2)     {moment} kg m^2 ({percent:.1f} %)")
    echo(f"  radius of gyration   {result.radius_of_gyration:.3f} m")
    shares = sorted(result.shares.items(), key=lambda item: -item[1])
    echo(f"  uncertainty from     {', '.join(f'{n} {100 * s:.0f} %' for n, s in shares if s >= 0.005)}\n")
    for text in said:
        echo(bullet("!", text))
    echo("\nHolds for")
    for text in CAVEATS:
        echo(bullet("-", text))


def _print_json(
    axis: Axis, test: SwingTest, result: Inertia, check: GravityCheck | None, said: list[str]
) -> None:
    data = {
        "axis": axis,
        "about": AXES[axis],
        "moment_kg_m2": asdict(result.moment),
        "radius_of_gyration_m": result.radius_of_gyration,
        "variance_shares": result.shares,
        "period_s": asdict(test.period),
        "gravity_check": check
        and {
            "gravity_m_s2": asdict(check.gravity),
            "percent": check.percent,
            "sigmas": check.sigmas,
            "passed": check.passed,
        },
        "remarks": said,
        "caveats": CAVEATS,
    }
    echo_json(json.dumps(data, indent=2))
