"""How often the 90 % intervals of `rover-sweep bench` hold the truth, on simulated servos of random numbers.

    python tests/benchmarks/bench_coverage.py [--hand N] [--wheel N]

Every draw is another rover: play, uneven gain, curve, band (half of them have none), lag, rate limit, trim.
By hand: a staircase read to half a degree. On the wheel: ramp and steps, an angle with 2 mrad of noise, or a
gyro with .01 rad/s of it. Prints the share of intervals that held the truth, and half their usual width. Some
4 minutes of one core.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

sys.path.pop(0)  # this folder, whose coverage.py numba would take for another one
sys.path.insert(0, str(Path(__file__).parents[2]))
sys.path.insert(0, str(Path(__file__).parents[1] / "bench"))

import numpy as np
from synthetic_servo import read_by_hand, rover, seen_by_imu, slope_by_hand

from rover_sweep.bench.bench_folder import BenchResult
from rover_sweep.bench.by_wheel import by_wheel
from rover_sweep.bench.evaluate import by_hand
from sitl.plant.variant import PlantParameters

BY_HAND, BY_WHEEL = (50.0, 100.0, 200.0, 300.0), (100.0, 250.0)  # us
Draw = tuple[BenchResult, dict[str, float]]


def drawn(rng: np.random.Generator, trim: float) -> tuple[PlantParameters, dict[str, float]]:
    """(a rover, its numbers by the names of a bench)."""
    truth = {
        "backlash": rng.uniform(0.002, 0.02),
        "asymmetry": rng.uniform(-0.1, 0.1),
        "nonlinearity": rng.uniform(-3, 3),
        "deadband": rng.choice([0.0, rng.uniform(0.003, 0.015)]),
        "servo_lag": rng.uniform(0.015, 0.06),
        "servo_rate_limit": rng.uniform(2.0, 6.0),
        "trim_us": trim,
    }
    names = ("backlash", "asymmetry", "nonlinearity", "deadband", "servo_lag", "servo_rate_limit", "trim_us")
    return rover(*(float(truth[name]) for name in names)), truth


def hand(rng: np.random.Generator) -> Draw:
    """A staircase read by hand."""
    parameters, truth = drawn(rng, 1500.0 + rng.uniform(-10, 10))
    reach = 300.0 - abs(parameters.steering_trim_us - 1500.0)
    truth["rad_per_us"] = slope_by_hand(parameters, reach)
    return by_hand(read_by_hand(parameters, BY_HAND, rng), 1500.0), truth


def wheel(as_rate: bool) -> Callable[[np.random.Generator], Draw]:
    """A ramp and steps seen by an IMU on the wheel."""

    def draw(rng: np.random.Generator) -> Draw:
        parameters, truth = drawn(rng, 1500.0)
        truth["servo_delay"] = parameters.servo_delay
        truth["centre"] = parameters.rad_per_us
        return by_wheel(*seen_by_imu(parameters, BY_WHEEL, rng, as_rate), 1.0), truth

    return draw


def study(name: str, draw: Callable[[np.random.Generator], Draw], count: int) -> None:
    """Prints the shares of `count` draws."""
    rng, held, half = np.random.default_rng(5), defaultdict(list), defaultdict(list)
    for _ in range(count):
        result, truth = draw(rng)
        for number in result.numbers:
            if number.name in truth:
                held[number.name].append(number.low <= truth[number.name] <= number.high)
                half[number.name].append(0.5 * (number.high - number.low) if number.determined else np.nan)
    print(f"{name}, {count} rovers")
    for name_of, these in held.items():
        measured, width = 100 * np.mean(np.isfinite(half[name_of])), np.nanmedian(half[name_of])
        share = 100 * np.mean(these)
        print(
            f"  {name_of:17} held by {share:3.0f} %, usually +-{width:.2g}, measured in {measured:.0f} %",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hand", type=int, default=300, help="benches by hand")
    parser.add_argument("--wheel", type=int, default=60, help="benches with an angle, and with a rate")
    options = parser.parse_args()
    study("by hand", hand, options.hand)
    study("an angle on the wheel", wheel(False), options.wheel)
    study("a rate on the wheel", wheel(True), options.wheel)


if __name__ == "__main__":
    main()
