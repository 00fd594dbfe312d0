"""`rover-sweep plan`: which effects a set of runs can detect and separate, before or after driving."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.types.options import (
    EFFECTS,
    NumberRange,
    filter_overrides,
    reading_options,
    vehicle_path,
)
from rover_sweep.cli.views.output import echo_json

if TYPE_CHECKING:
    from rover_sweep.diagnosis.plans.plan_result import PlannedRun

_NUMBER = r"[0-9]+\.?[0-9]*"
MOST_US, MOST_SPEED = 500, 30  # us from trim and m/s: limits of the servo output and of the applet
_RUN = re.compile(rf"({_NUMBER})(?:([+-]{_NUMBER}))?@({_NUMBER})(?:@(-?{_NUMBER}))?")


class PlannedRunType(click.ParamType):
    """A run as AMPLITUDE@SPEED in us and m/s; with a heading in deg 150@2.4@90; with a bias 100+150@2.4."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.name = f"AMPLITUDE{'+BIAS' if self.biased else ''}@SPEED"

    @property
    def biased(self) -> bool:
        """True for a bias sweep, which needs a bias."""
        return self.kind == "bias_sweep"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> PlannedRun:
        """The run; a usage error that shows the correct form."""
        from rover_sweep.diagnosis.plans.plan_result import PlannedRun

        if isinstance(value, PlannedRun):
            return value
        found = _RUN.fullmatch(str(value).strip())
        if not found or (found[2] is not None) != self.biased:
            self.fail(self._mistake(str(value).strip()), param, ctx)
        amplitude, bias, speed = float(found[1]), float(found[2] or 0.0), float(found[3])
        if not (amplitude >= 1 and amplitude + abs(bias) <= MOST_US and 0 < speed <= MOST_SPEED):
            peak = ", bias included" if self.biased else ""
            self.fail(
                f"{value!r}: an amplitude is 1..{MOST_US} us{peak} and a speed up to {MOST_SPEED} m/s",
                param,
                ctx,
            )
        heading = float(found[4]) % 360.0 if found[4] else None
        return PlannedRun(self.kind, amplitude, speed, heading, bias)  # type: ignore[arg-type]

    def _mistake(self, value: str) -> str:
        """The mistake in a run's text, and the correct form."""
        example = "100+150@2.4" if self.biased else "150@2.4"
        written = f"write it as {example}, us and m/s (@90 for a heading)"
        if re.fullmatch(rf"{_NUMBER}([+-]{_NUMBER})?", value):
            return f"{value!r} has no speed; {written}"
        if value.startswith("-"):
            return f"{value!r} has a negative amplitude; give the peak, which is positive; {written}"
        if "," in value:
            return f"{value!r} has a decimal comma; {written}"
        if self.biased and "@" in value and not re.search(r"[0-9][+-][0-9]", value):
            return f"{value!r} has no bias; {written}"
        if not self.biased and re.match(rf"{_NUMBER}[+-]", value):
            return f"{value!r} has a bias, which only --bias-sweep takes; {written}"
        return f"{value!r} is not a run; {written}"


def _run_option(name: str, kind: str, words: str) -> Any:
    return click.option(name, multiple=True, type=PlannedRunType(kind), help=f"{words}; may be repeated.")


@click.command()
@click.option(
    "--vehicle",
    "vehicle_file",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="Vehicle file (default: rover.toml here).",
)
@click.option("--have", multiple=True, metavar="RUN", help="A run already driven; may be repeated.")
@_run_option("--sweep", "sweep", "Sweep with this peak (us) and speed (m/s)")
@_run_option("--doublet", "doublet", "Doublet")
@_run_option("--bias-sweep", "bias_sweep", "Sweep about a steering bias, as 100+150@2.4")
@_run_option("--multisine", "multisine", "Odd/even multisine, which shows harmonics")
@click.option(
    "--servo-test",
    "servo_test",
    multiple=True,
    type=NumberRange(1, MOST_US),
    metavar="US",
    help="Sweep of this peak on blocks with the wheel angle measured.",
)
@click.option("--want", type=EFFECTS, default=(), help="Only these effects must be detected and separated.")
@reading_options
@click.option("--json", "as_json", is_flag=True, help="Print the plan as JSON on stdout.")
def plan(
    vehicle_file: str | None,
    have: tuple[str, ...],
    sweep: tuple[PlannedRun, ...],
    doublet: tuple[PlannedRun, ...],
    bias_sweep: tuple[PlannedRun, ...],
    multisine: tuple[PlannedRun, ...],
    servo_test: tuple[float, ...],
    want: tuple[str, ...],
    columns: str | None,
    gyro_filter: float | None,
    accel_filter: float | None,
    system: int | None,
    as_json: bool,
) -> None:
    """Show which effects a set of runs can separate, and propose the runs that tell most.

    \b
    rover-sweep plan --vehicle rover.toml --sweep 120@2.4 --sweep 240@2.4 --doublet 150@2.4
    rover-sweep plan --vehicle rover.toml --have run1.BIN --have run2.BIN --want tyre_saturation,load_transfer

    Equal runs count as repeats. Without any run, a first set is proposed. An effect counts as separated where
    a diagnosis is expected to name it, with 80 %.
    """
    from rover_sweep.api.diagnosis_input import effects_named
    from rover_sweep.api.plan import as_planned, merged, plan_runs
    from rover_sweep.api.read import Reading, load_steered
    from rover_sweep.api.run_roles import refuse_overlap
    from rover_sweep.cli.views.long_work import long_work
    from rover_sweep.cli.views.output import narration, print_warnings
    from rover_sweep.data.vehicle_file import load as load_vehicle
    from rover_sweep.diagnosis.plans.plan_result import PlannedRun

    wanted = effects_named(want)
    vehicle = load_vehicle(Path(vehicle_path(vehicle_file, have)))
    vehicle.steering()  # raises here if the file has no steering gain, before anything is read
    reading = Reading(columns, filter_overrides(gyro_filter, accel_filter), system)
    driven = load_steered(have, vehicle, reading) if have else ()
    print_warnings(narration(), driven)
    refuse_overlap(driven, ())
    blocks = [PlannedRun("servo_test", amplitude, 0.0) for amplitude in servo_test]
    runs = merged(
        [*(as_planned(run, vehicle) for run in driven), *sweep, *doublet, *bias_sweep, *multisine, *blocks]
    )
    with long_work("computing which effects these runs separate") as report:
        found = plan_runs(runs, vehicle, wanted, driven, lambda what, share: report(share, what))
    _show(found, as_json)


def _show(found: Any, as_json: bool) -> None:
    from rover_sweep.cli.views.output import results
    from rover_sweep.report.diagnosis.plan_table import plan_document, plan_summary
    from rover_sweep.report.diagnosis.terminal import WIDTH
    from rover_sweep.report.wording.strict_json import strict_json

    if as_json:
        echo_json(strict_json(plan_document(found)))
        return
    console = results()
    console.print(plan_summary(found), width=min(console.width, WIDTH))
