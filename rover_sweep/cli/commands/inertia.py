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
from rover_sweep.cli.options import FILE, NumberRange, measured_type, numbers_type, option, options
from rover_sweep.cli.views.display import bullet
from rover_sweep.cli.views.output import echo, echo_json, say_next
from rover_sweep.data.plausibility import ROLL_GYRATION, YAW_GYRATION
from rover_sweep.data.vehicle_file import Measured, Vehicle, load, set_numbers
from rover_sweep.errors import DataRefused, UsageError

MASS = measured_type(0.05, 5000, "kg", "give kilograms")
GYRATION = {"yaw": YAW_GYRATION, "roll": ROLL_GYRATION}
TIMES = numbers_type("times", "s", 3600)
LENGTH = measured_type(0.05, 20, "m", "give metres")


_AXIS = option(
    "Axis of the rover that is vertical in the test.", click.Choice(["yaw", "roll"]), default="yaw"
)
_MASS = option("Mass on the wires, kg. [default for yaw: mass in the --vehicle or --write file]", MASS)
_LENGTH = option("h, length of the wires between the clamps, m.", LENGTH, required=True)
_SPACING = option("d, distance between the wires, m.", LENGTH, required=True)
_RIG_MASS = option("Mass of a board or cradle under the rover, kg.", MASS)


@click.command()
@options
def inertia(
    axis: Axis = _AXIS,
    mass: Measured | None = _MASS,
    length: Measured = _LENGTH,
    spacing: Measured = _SPACING,
    times: tuple[float, ...] = option(
        "Times of the twisting swing, each for --swings swings.", TIMES, required=True
    ),
    swings: int = option("Full periods in each time.", click.IntRange(1), default=1),
    check_times: tuple[float, ...] | None = option("Times of the swing in the plane of the wires.", TIMES),
    check_swings: int | None = option(
        "Full periods in each check time. [default: --swings]", click.IntRange(1)
    ),
    rig_mass: Measured | None = _RIG_MASS,
    rig_times: tuple[float, ...] | None = option(
        "Times of the rig without the rover, each for --swings swings.", TIMES
    ),
    timer_sd: float = option(
        "Standard deviation of one time, s; 0.2 by hand.", NumberRange(0, 5), default=0.2
    ),
    vehicle: str | None = option("Vehicle file that gives the mass, for comparison.", FILE),
    write: str | None = option("Vehicle file to write the result into; keeps its comments.", FILE),
    force: bool = option("With --write: write the result even if a check fails."),
    as_json: bool = option("Print the numbers as JSON on stdout.", flag="--json"),
) -> None:
    """Compute a moment of inertia from a swing test.

    Hang the rover on two parallel vertical wires of the same length, one on each side of its CG. First
    swing it in the plane of the wires and time the swings (--check-times): they must give 9.81 m/s^2. Then
    twist it by a few degrees about the vertical, release it, and time the swings (--times). A number may
    have a standard deviation, as in --length 1.200+-0.003.

    \b
    rover-sweep inertia --mass 2.66+-0.005 --length 1.200+-0.003 --spacing 0.300+-0.001 \\
      --swings 20 --times 47.5,47.3,47.6 --check-times 43.9,44.1 --write rover.toml
    """
    file = vehicle or write
    rover = load(file) if file else None
    hung = mass or (rover.mass if rover and axis == "yaw" else None)
    if hung is None:
        yaw = "give it, or a --vehicle file that has the mass"
        roll = "give the mass on the wires, preferably the chassis without wheels and axles"
        raise click.UsageError(f"--mass is missing; {yaw if axis == 'yaw' else roll}")
    if (rig_mass is None) != (rig_times is None):
        raise click.UsageError("--rig-mass and --rig-times go together")
    rig_period = Swings(rig_times, swings, timer_sd).period if rig_times else None
    test = SwingTest(hung, length, spacing, Swings(times, swings, timer_sd).period, rig_mass, rig_period)
    result = moment_of_inertia(test)
    if result.moment.value <= 0:
        raise UsageError(
            "the rig has more inertia than rover and rig together "
            f"(difference {result.moment.value:.3g} kg m^2); check --times and --rig-times"
        )
    swing = Swings(check_times, check_swings or swings, timer_sd).period if check_times else None
    check = gravity_check(length, swing) if swing else None
    gyration = _gyration(axis, result, rover)
    notes = (
        remarks(test, result, check, swing) + _against(axis, hung, rover) + ([gyration] if gyration else [])
    )
    if as_json:
        _print_json(axis, test, result, check, notes)
    else:
        _print(axis, test, result, check, notes, len(times), swings)
    if write:
        faults = [f"g is {check.percent:+.1f} % off"] if check is not None and not check.passed else []
        faults += [gyration] if gyration else []
        if faults and not force:
            raise DataRefused(
                f"not written into {write}: {'; '.join(faults)}; repeat the test, or use --force"
            )
        set_numbers(write, {KEY[axis]: rounded(result.moment)})
        key = KEY[axis].partition(".")[2]
        echo(f"{key} = {rounded(result.moment)} kg m^2 written into {write}", err=True)
    if not as_json:
        say_next(f"rover-sweep vehicle check {write}" if write else "give --write rover.toml to keep it")


def _against(axis: Axis, hung: Measured, rover: Vehicle | None) -> list[str]:
    """Remarks where the mass on the wires differs from the vehicle file."""
    whole_body = (
        "roll_inertia is that of the sprung mass about its own CG: swing the chassis without wheels and "
        "axles, or use this value as an upper bound"
    )
    if rover is None:
        return [f"{whole_body} if the whole vehicle was on the wires"] if axis == "roll" else []
    notes = []
    expected = rover.mass if axis == "yaw" else rover.sprung_mass
    if expected and abs(hung.value / expected.value - 1) > 0.02:
        what = "mass" if axis == "yaw" else "sprung_mass"
        notes.append(
            f"the mass on the wires is {hung.value:g} kg; the vehicle file has {what} = {expected.value:g} kg"
        )
        if axis == "roll":
            notes.append(whole_body)
    return notes


def _gyration(axis: Axis, result: Inertia, rover: Vehicle | None) -> str:
    """A sentence if the radius of gyration is implausible for the wheelbase, else ''."""
    if rover is None:
        return ""
    share, (low, high) = result.radius_of_gyration / rover.wheelbase, GYRATION[axis]
    if low <= share <= high:
        return ""
    return (
        f"the radius of gyration {result.radius_of_gyration:.2g} m is {share:.2g} times the wheelbase "
        f"{rover.wheelbase:.3g} m (plausible: {low:g} to {high:g}); check the units, the number of "
        "swings, and that --times and --check-times are not swapped"
    )


def _print(
    axis: Axis,
    test: SwingTest,
    result: Inertia,
    check: GravityCheck | None,
    notes: list[str],
    times: int,
    swings: int,
) -> None:
    moment = rounded(result.moment)
    percent = 100 * (result.moment.sd or 0.0) / result.moment.value
    echo(f"Swing test, {axis} axis: {AXES[axis]}\n")
    if check is not None:
        verdict = "passed" if check.passed else "FAILED"
        echo(f"  g, equation (1)      {rounded(check.gravity)} m/s^2, {check.percent:+.1f} %: {verdict}")
    echo(f"  period               {rounded(test.period)} s ({times} x {swings} swings)")
    echo(f"  inertia, eq. (2)     {moment} kg m^2 ({percent:.1f} %)")
    echo(f"  radius of gyration   {result.radius_of_gyration:.3f} m")
    shares = sorted(result.shares.items(), key=lambda item: -item[1])
    echo(f"  uncertainty from     {', '.join(f'{n} {100 * s:.0f} %' for n, s in shares if s >= 0.005)}\n")
    for text in notes:
        echo(bullet("!", text))
    echo("\nValid for")
    for text in CAVEATS:
        echo(bullet("-", text))


def _print_json(
    axis: Axis, test: SwingTest, result: Inertia, check: GravityCheck | None, notes: list[str]
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
        "remarks": notes,
        "caveats": CAVEATS,
    }
    echo_json(json.dumps(data, indent=2))
