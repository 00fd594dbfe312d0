"""Speed lost in turns is found where it exceeds the drag of the turned wheels, and not otherwise."""

from pathlib import Path

import pytest

from rover_sweep.api.read import read
from rover_sweep.data.geometry import Geometry, Tolerances
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.posterior.speed_loss import SpeedLoss, speed_loss
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import Experiment, experiment
from tests.concealed.sets import draw_case, write_set

NOMINAL = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal"


def _runs(folder: Path, vehicle: Path) -> tuple[list[Experiment], Geometry]:
    runs = read(*(folder / f"run{k}.BIN" for k in (1, 2, 3)), vehicle=vehicle)
    return [experiment(run) for run in runs], geometry_of(runs.vehicle)


def _judged(folder: Path, vehicle: Path) -> SpeedLoss:
    runs, rover = _runs(folder, vehicle)
    model = Model("roll-yaw", rover, Tolerances())
    _, fitted = fit_with_floor(runs, model, {})
    return speed_loss(runs, model.structure, fitted.x, seed=1)


@pytest.mark.parametrize("number", [1, 2])
def test_a_loss_beyond_the_wheels_own_is_found_and_sized(tmp_path: Path, number: int) -> None:
    write_set(draw_case(31, number, "single", 2.0, "speed_variation"), tmp_path / "set", tmp_path / "t.json")
    found = _judged(tmp_path / "set", tmp_path / "set" / "rover.toml")
    assert found.found
    assert found.loss == pytest.approx(0.03, rel=0.35)
    assert found.low < found.loss < found.high
    assert 0.2 < found.lag < 1.2


def test_the_drag_of_the_turned_wheels_is_not_a_finding(tmp_path: Path) -> None:
    write_set(draw_case(32, 1, "none"), tmp_path / "set", tmp_path / "t.json")
    assert not _judged(tmp_path / "set", tmp_path / "set" / "rover.toml").found


def test_the_firmwares_rover_loses_no_more_than_that() -> None:
    found = _judged(NOMINAL, NOMINAL.parents[1] / "rover.toml")
    assert not found.found
    assert found.high < 0.02
