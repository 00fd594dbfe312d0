"""The steering benched on the real firmware: what is found beside what its plant was made with.

    python tests/benchmarks/bench_on_firmware.py --ardurover FILE [--variant FILE] [--out DIR]

Starts ArduRover (SITL) with a plant whose steering has play, an uneven gain and a slow servo, and moves it
twice as `rover-sweep bench` does, disarmed, in MANUAL, by RC override: in ramps and steps with an IMU on the
wheel (1 mrad of noise), then in a staircase whose angles are read to half a degree. Prints every number with
its 90 % interval and the truth. Some 5 minutes.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
import tempfile
import time
from math import degrees, nan, radians
from pathlib import Path

sys.path.pop(0)  # this folder, whose coverage.py numba would take for another one
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from firmware_params.param_files import shipped
from rover_sweep.bench.bench_folder import BenchFolder, BenchResult
from rover_sweep.bench.drive import BenchPlan, Keep, Movement, WheelSource, drive_bench, programme
from rover_sweep.bench.evaluate import evaluate
from rover_sweep.data.vehicle_file import load
from sitl.launcher import Running, find_ardurover, start_ardurover
from sitl.plant.variant import PlantParameters, load_variant

ROVER = Path(__file__).parents[1] / "data" / "rover.toml"
VARIANT = """base = "nominal"
servo_rate_limit = 3.0
servo_lag = 0.035
[effects]
steering_backlash = { b = 0.012 }
steering_asymmetry = { e = 0.05 }
"""
BY_IMU, BY_HAND = (100.0, 250.0), (50.0, 100.0, 200.0, 300.0)  # us
LOOP = 0.01  # s, main loop: SERVO_OUTPUT_RAW tells a PWM up to that long before the plant has it
TO, TAIL = 0.5, 400  # deg to which an angle is read; bytes of the wheel's file that are the newest


class Beside:
    """Somebody beside the rover: allows all, and reads angles off the plant's wheel."""

    def __init__(self, wheel: Path) -> None:
        self.wheel = wheel

    def tell(self, text: str) -> None:
        print(f"  {text}", file=sys.stderr)

    def allow(self, movement: Movement, stops: str, keep: Keep) -> bool:
        self.tell(f"{movement.name}: {movement.words}\n  {stops}")
        return True

    def angle(self, number: int, of: int, offset: float, keep: Keep) -> tuple[float, str]:
        for _ in range(5):
            keep()
        read = TO * round(degrees(_newest(self.wheel)) / TO)
        return radians(read), f"{read:g}"


def _newest(wheel: Path) -> float:
    """Mean of the last whole lines of the wheel's file, rad."""
    with wheel.open("rb") as file:
        file.seek(max(0, wheel.stat().st_size - TAIL))
        lines = file.read().decode("ascii").splitlines()[1:-1]
    return float(np.mean([float(line.split(",")[1]) for line in lines]))


def truth_of(rover: PlantParameters) -> dict[str, float]:
    """{name of a number of the bench: what the plant was made with}."""
    effects = rover.effects
    return {
        "rad_per_us": rover.rad_per_us,
        "trim_us": rover.steering_trim_us,
        "asymmetry": effects.get("steering_asymmetry", {}).get("e", 0.0),
        "nonlinearity": effects.get("steering_nonlinearity", {}).get("c3", 0.0),
        "deadband": effects.get("steering_deadband", {}).get("w", 0.0),
        "backlash": effects.get("steering_backlash", {}).get("b", 0.0),
        "servo_lag": rover.servo_lag,
        "servo_rate_limit": rover.servo_rate_limit,
        "servo_delay": rover.servo_delay,
    }  # type: ignore[dict-item]


def report(result: BenchResult, truth: dict[str, float]) -> None:
    """Each number beside the truth."""
    print(f"{result.source}, {result.samples} samples")
    for number in result.numbers:
        true = truth.get(number.name, nan)
        slack = LOOP if number.name == "servo_delay" else 0.0
        held = "" if np.isnan(true) else "held" if number.low - slack <= true <= number.high else "NOT HELD"
        print(
            f"  {number.name:17} {number.value:10.5g}  {number.low:10.5g} to {number.high:10.5g}  "
            f"{number.unit:8} truth {true:8.5g}  {held}"
        )


def by_imu(rover: Running, folder: Path, wheel: Path) -> BenchResult:
    """Ramps and steps."""
    bench = _folder(folder / "imu")
    plan = BenchPlan(programme(BY_IMU, False, True), WheelSource(file=wheel, same_clock=True), unasked=True)
    assert drive_bench(rover.connection, bench, plan, Beside(wheel))
    return evaluate(bench, load(ROVER))


def by_hand(rover: Running, folder: Path, wheel: Path) -> BenchResult:
    """A staircase."""
    bench = _folder(folder / "hand")
    assert drive_bench(rover.connection, bench, BenchPlan(programme(BY_HAND, True, False)), Beside(wheel))
    return evaluate(bench, load(ROVER))


def _folder(path: Path) -> BenchFolder:
    path.mkdir(parents=True)
    return BenchFolder(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ardurover", help="the SITL program (else $ROVER_SWEEP_ARDUROVER or the PATH)")
    parser.add_argument("--variant", type=Path, help="another plant, as of `rover-sweep dry-run --variant`")
    parser.add_argument("--out", type=Path, help="keep everything in this folder")
    options = parser.parse_args()
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.out or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        variant = options.variant or folder / "variant.toml"
        if options.variant is None:
            variant.write_text(VARIANT, encoding="ascii")
        binary, wheel = find_ardurover(options.ardurover), folder / "wheel.csv"
        with start_ardurover(
            binary, folder / "vehicle", variant=variant, wheel=wheel, defaults=[shipped("identification")]
        ) as rover:
            for bench in (by_imu, by_hand):
                report(bench(rover, folder, wheel), truth_of(load_variant(variant)))
    print(f"{time.monotonic() - begun:.0f} s in all")


if __name__ == "__main__":
    main()
