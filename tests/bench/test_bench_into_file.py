"""What of a bench goes into the vehicle file, so that a steering angle made with it is the wheel's."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from synthetic_servo import read_by_hand, rover

from rover_sweep.bench.bench_folder import (
    BenchResult,
    interval,
    numbers_for_file,
    rate_limit,
    write_bench_numbers,
)
from rover_sweep.bench.evaluate import by_hand
from rover_sweep.bench.static_curve import curve
from rover_sweep.data.vehicle_file import load
from sitl.plant.effects.steering_effects import Linkage

ROVER = Path(__file__).parents[1] / "data" / "rover.toml"
LEVELS = (50.0, 100.0, 200.0, 300.0)


def result(**numbers: tuple[float, float]) -> BenchResult:
    """With these values and standard deviations."""
    keys = {n: "" if n == "rad_per_us" else f"steering.{n}" for n in numbers}
    found = [interval(n, "-", *x, 1.645, "", keys[n]) for n, x in numbers.items()]
    return BenchResult("made up", tuple(found), (), (), 0.0, 1)


def test_what_may_be_nothing_is_written_as_nothing_with_what_it_might_be():
    found = numbers_for_file(result(rad_per_us=(0.001, 1e-5), backlash=(0.01, 0.001), asymmetry=(0.01, 0.02)))
    assert found["steering.backlash"].value == 0.01
    assert found["steering.asymmetry"].value == 0.0
    assert found["steering.asymmetry"].sd == pytest.approx(np.hypot(0.01, 0.02), rel=0.1)


def test_a_slope_hardly_known_and_a_limit_that_nothing_reached_are_left_out():
    found = result(rad_per_us=(0.001, 2e-4), backlash=(0.01, 0.001))
    with_limit = BenchResult("", (*found.numbers, rate_limit(0.0, 0.1, 1.645)), (), (), 0.0, 1)
    assert set(numbers_for_file(with_limit)) == {"steering.backlash"}


@pytest.mark.parametrize(("c3", "w"), [(0.0, 0.0), (4.0, 0.0), (0.0, 0.02), (3.0, 0.01)])
def test_the_angles_of_the_file_are_those_of_the_wheel(tmp_path: Path, c3: float, w: float):
    """Within the accuracy of angles read to half a degree, whatever of curve and band was found."""
    made = rover(b=0.006, e=0.05, c3=c3, w=w)
    target = Path(shutil.copy(ROVER, tmp_path / "rover.toml"))
    write_bench_numbers(target, by_hand(read_by_hand(made, LEVELS, np.random.default_rng(2)), 1500.0))
    file = load(target)
    offset = np.linspace(-300, 300, 25)
    u = -(1500 + offset - file.trim_us.value) * file.rad_per_us.value
    mine = curve(u, file.asymmetry.value, file.nonlinearity.value, file.deadband.value)
    still = Linkage({k: v for k, v in made.effects.items() if k != "steering_backlash"})
    true = [still.wanted(-x * made.rad_per_us) for x in offset.tolist()]
    assert np.abs(mine - true).max() < np.radians(0.5)
    assert (file.nonlinearity.value != 0.0) == (c3 != 0.0 or file.deadband.value != 0.0)
