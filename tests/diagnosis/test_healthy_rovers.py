"""On healthy rovers nothing is named, and the intervals hold the truth; speed is lost in turns as usual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from healthy import NOMINAL, RUNS, exact_vehicle_file, examined

import rover_sweep as rs
from rover_sweep.data.geometry import Tolerances
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.posterior.speed_loss import SpeedLoss, speed_loss
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import experiment
from sitl.plant.variant import load_variant
from tests.comparison.pairs import drive


def test_nothing_is_named_on_a_healthy_rover() -> None:
    """Seed 1: 1.6 times the nominal length. Its tyres bend by a law of the other simulation."""
    found = examined(1, RUNS[1:])
    assert found.verdict == "none", found.names
    assert all(found.inside.values()), found.inside


@pytest.mark.slow
def test_at_most_one_of_twenty_healthy_rovers_gets_a_name() -> None:
    every = [examined(seed) for seed in range(100, 120)]
    assert sum(bool(one.names) for one in every) <= 1, [one.names for one in every]
    for name in every[0].inside:
        assert sum(one.inside[name] for one in every) >= 16, name


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.5, 0.65])
def test_nothing_is_named_on_a_slow_healthy_rover(tmp_path: Path, share: float) -> None:
    """The speed's error is 1.5 % of such a speed; a law over V r would read it as an effect."""
    rover, vehicle = load_variant("nominal"), tmp_path / "rover.toml"
    vehicle.write_text(exact_vehicle_file(rover))
    logs = drive(rover, RUNS, tmp_path / "runs", 7, share)
    runs = rs.read(*map(str, logs[:2]), vehicle=vehicle)
    assert rs.diagnose(runs, rs.read(str(logs[2]), vehicle=vehicle)).verdict == "none"


# ---- Speed lost in turns is found where it exceeds the drag of the turned wheels, and not otherwise.


def judged(paths: Sequence[Path]) -> SpeedLoss:
    read = rs.read(*paths, vehicle=NOMINAL.parents[1] / "rover.toml")
    assert read.vehicle is not None
    runs = [experiment(run) for run in read]
    model = Model("roll-yaw", geometry_of(read.vehicle), Tolerances())
    _, fitted = fit_with_floor(runs, model, {})
    return speed_loss(runs, model, fitted.x, seed=1)


def driven(folder: Path, seed: int, **effects: dict[str, float]) -> SpeedLoss:
    """The nominal rover with these effects, driven like a recorded sweep."""
    rover = replace(load_variant("nominal"), effects=effects)
    return judged(drive(rover, RUNS[1:2], folder / "set", seed))


def test_a_loss_beyond_the_wheels_own_is_found_and_sized(tmp_path: Path) -> None:
    """The driver's throttle makes good a part of it, so less than D is seen."""
    found = driven(tmp_path, 1, speed_variation={"D": 0.1})
    assert found.found
    assert 0.03 < found.low < found.loss < found.high < 0.1


@pytest.mark.slow
def test_the_drag_of_the_turned_wheels_is_not_a_finding(tmp_path: Path) -> None:
    assert not driven(tmp_path, 3).found


def test_the_firmwares_rover_loses_no_more_than_that() -> None:
    found = judged(RUNS[:2])
    assert not found.found
    assert found.high < 0.02
