"""Speed lost in turns is found where it exceeds the drag of the turned wheels, and not otherwise."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from rover_sweep.api.read import read
from rover_sweep.data.geometry import Tolerances
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.posterior.speed_loss import SpeedLoss, speed_loss
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import experiment
from sitl.plant.variant import load_variant
from tests.comparison.pairs import drive

NOMINAL = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal"
VEHICLE = NOMINAL.parents[1] / "rover.toml"


def _judged(paths: Sequence[Path]) -> SpeedLoss:
    read_runs = read(*paths, vehicle=VEHICLE)
    runs = [experiment(run) for run in read_runs]
    model = Model("roll-yaw", geometry_of(read_runs.vehicle), Tolerances())
    _, fitted = fit_with_floor(runs, model, {})
    return speed_loss(runs, model, fitted.x, seed=1)


def _driven(folder: Path, seed: int, **effects: dict[str, float]) -> SpeedLoss:
    """The nominal rover with these effects, driven like the recordings."""
    rover = replace(load_variant("nominal"), effects=effects)
    return _judged(drive(rover, [NOMINAL / f"run{k}.BIN" for k in (1, 2)], folder / "set", seed))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_loss_beyond_the_wheels_own_is_found_and_sized(tmp_path: Path, seed: int) -> None:
    """The driver's throttle makes good a part of it, so less than D is seen."""
    found = _driven(tmp_path, seed, speed_variation={"D": 0.1})
    assert found.found
    assert 0.04 < found.low < found.loss < found.high < 0.1


@pytest.mark.slow
def test_the_drag_of_the_turned_wheels_is_not_a_finding(tmp_path: Path) -> None:
    assert not _driven(tmp_path, 3).found


def test_the_firmwares_rover_loses_no_more_than_that() -> None:
    found = _judged([NOMINAL / f"run{k}.BIN" for k in (1, 2, 3)])
    assert not found.found
    assert found.high < 0.02
