"""`rover-sweep bench`: measure the steering with the front wheels off the ground, for the vehicle file."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rover_sweep.cli.options import FILE, FOLDER, numbers_type, option, options, session_folder, vehicle_path
from rover_sweep.cli.vehicle_link import ACCESS, MAYBE_CONNECT
from rover_sweep.cli.views.output import echo, echo_json, say_next
from rover_sweep.errors import RoverSweepError, UsageError

if TYPE_CHECKING:
    from rover_sweep.bench.bench_folder import BenchFolder, BenchResult
    from rover_sweep.bench.drive import BenchPlan
    from rover_sweep.data.vehicle_file import Measured
    from rover_sweep.vehicle.link.connection import Access

STEPS = (50.0, 100.0, 150.0)


@click.command()
@options
def bench(
    connect: str | None = MAYBE_CONNECT,
    access: Access = ACCESS,
    vehicle: str | None = option("Vehicle file to read and update (default: rover.toml here).", FILE),
    hand: bool = option("Read the wheel angles by hand and type them."),
    wheel_imu: str | None = option(
        "IMU on the wheel: CSV file of its logger, or MAVLink URL of its autopilot.", metavar="FILE|URL"
    ),
    wheel_clock: str | None = option(
        "Clock of the CSV. The delay needs the vehicle's clock. [default: own]",
        click.Choice(["own", "vehicle"]),
    ),
    steps: tuple[float, ...] = option(
        "Step sizes from the servo's trim, us; each is made to both sides.",
        numbers_type(),
        default=",".join(f"{s:g}" for s in STEPS),
    ),
    ramp: bool = option("With --hand: add a slow ramp, to watch the wheels."),
    recorded: str | None = option(
        "Evaluate a recorded bench test; nothing is connected.", FOLDER, flag="--from"
    ),
    out: str | None = option("Folder for the recording. [default: bench, else bench-2, ...]", FOLDER),
    no_write: bool = option("Do not change the vehicle file."),
    yes: bool = option("Do not ask; allowed only on a simulated rover."),
    as_json: bool = option("Print the numbers as JSON on stdout.", flag="--json"),
) -> None:
    """Measure the steering on blocks: gain, asymmetry, curve, play, dead band, lag, rate limit.

    Put the rover on blocks with its front wheels off the ground: DISARMED, in MANUAL, radio on, throttle
    stick at rest. The motor cannot turn then. The program moves only the steering channel, by RC override,
    and asks before each movement. It writes the results into the vehicle file.

    To stop at once without the laptop: set the mode switch to HOLD or cut the rover's power. The program
    releases the steering when the rover is armed, the throttle stick moves, the rover moves or the output
    does not follow; Ctrl-C stops it too. If the program or its link dies, the radio has the steering back
    after RC_OVERRIDE_TIME, which must not exceed 3 s.

    The CSV needs a header with a time (t, time_ms, time_us) and the wheel's angle (angle, angle_deg, yaw) or
    rate (rate, rate_deg_s, gyro_z), of either sign, at 50 Hz or more. It is read after the last movement,
    or later with --from.

    \b
    rover-sweep bench --connect /dev/ttyUSB0,57600 --vehicle rover.toml --hand --steps 100,200,300
    rover-sweep bench --from bench --vehicle rover.toml --wheel-imu wheel.csv
    """
    from rover_sweep.bench.bench_folder import BenchFolder, write_bench_numbers
    from rover_sweep.bench.drive import BenchPlan, WheelSource, programme
    from rover_sweep.bench.evaluate import evaluate
    from rover_sweep.data.vehicle_file import load
    from rover_sweep.vehicle.link.transport import looks_like_url, parse_url

    path = Path(vehicle_path(vehicle))
    load(path)
    if (connect is None) == (recorded is None):
        raise click.UsageError(
            "give either --connect URL to measure a rover, or --from DIR to evaluate a recorded bench test"
        )
    given, whole = None, True
    if recorded is not None:
        folder, given = BenchFolder(Path(recorded)), Path(wheel_imu) if wheel_imu else None
    else:
        assert connect is not None
        if hand == (wheel_imu is not None):
            raise click.UsageError("choose how to measure the wheel angle: --hand or --wheel-imu FILE or URL")
        wheel = None
        if wheel_imu and looks_like_url(wheel_imu):
            parse_url(wheel_imu)
            wheel = WheelSource(url=wheel_imu)
        elif wheel_imu:
            wheel = WheelSource(file=Path(wheel_imu), same_clock=wheel_clock == "vehicle")
        if not yes and not sys.stdin.isatty():
            raise UsageError(
                "bench asks before each movement, but stdin is not a terminal; run it in a terminal"
            )
        plan = BenchPlan(programme(steps, hand, ramp), wheel, yes)
        folder = BenchFolder(session_folder(out, "bench", ("bench.json", "readings.csv")))
        whole = _driven(connect, access, folder, plan)
    if not whole:
        echo("not all movements were carried out; evaluating the recorded ones", err=True)
    result = evaluate(folder, load(path), given, None if wheel_clock is None else wheel_clock == "vehicle")
    written = {} if no_write else write_bench_numbers(path, result)
    (_print_json if as_json else _print)(result, written, folder, path)


def _driven(url: str, access: Access, folder: BenchFolder, plan: BenchPlan) -> bool:
    """True if all movements were carried out. Before an error leaves, prints where the recording is."""
    from rover_sweep.bench.drive import drive_bench
    from rover_sweep.cli.views.asking import Terminal, let_go_on_signals
    from rover_sweep.vehicle.link.transport import parse_url

    parse_url(url)
    echo(f"recording into {folder.path}", err=True)
    try:
        with let_go_on_signals():
            return drive_bench(
                url, folder, plan, Terminal(lambda text: echo(text, err=True), plan.unasked), access
            )
    except (RoverSweepError, KeyboardInterrupt):
        echo(
            "this program no longer moves the steering (over a lost link its override lapses); evaluate the "
            f"recording with: rover-sweep bench --from {folder.path}",
            err=True,
        )
        raise


def _print(result: BenchResult, written: dict[str, Measured], folder: BenchFolder, path: Path) -> None:
    from rover_sweep.cli.views.display import bullet

    echo(f"Steering on blocks, {result.source}, {result.samples} samples, {folder.path}\n")
    for number in result.numbers:
        if number.determined:
            span = f"{number.low:.4g} to {number.high:.4g}"
            echo(f"  {number.name:17} {number.value:>10.4g} {number.unit:8} {span:26} {number.meaning}")
    echo("  (90 % intervals)\n")
    for text in result.untold:
        echo(bullet("-", f"not determined: {text}"))
    for text in result.remarks:
        echo(bullet("!", text))
    if written:
        echo(f"\nwritten into {path}: {', '.join(key.partition('.')[2] for key in written)}")
    say_next(f"rover-sweep vehicle check {path}" if written else f"rover-sweep bench --from {folder.path}")


def _print_json(result: BenchResult, written: dict[str, Measured], folder: BenchFolder, path: Path) -> None:
    def plain(value: Any) -> Any:
        return None if isinstance(value, float) and not isfinite(value) else value

    numbers = [{key: plain(value) for key, value in asdict(number).items()} for number in result.numbers]
    content = {
        **asdict(result),
        "numbers": numbers,
        "folder": str(folder.path),
        "vehicle_file": str(path),
        "written": {key: asdict(number) for key, number in written.items()},
    }
    echo_json(json.dumps(content, indent=2))
