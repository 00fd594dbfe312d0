"""[material] of the vehicle file reaches the diagnosis and the plan."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from fabricated_engine import Engine, ProgramResult

from rover_sweep.data.vehicle_file import load
from rover_sweep.data.vehicle_geometry import tolerances_of

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
RunProgram = Callable[..., ProgramResult]


@pytest.fixture
def vehicle(tmp_path: Path) -> Path:
    text = (DATA / "rover.toml").read_text(encoding="utf-8")
    path = tmp_path / "rover.toml"
    path.write_text(text.replace("servo_lag = 0.040", "servo_lag = 0.015"), encoding="utf-8")
    return path


def test_diagnosis_is_made_with_them(
    engine: Engine, run_program: RunProgram, vehicle: Path, tmp_path: Path
) -> None:
    runs = (NOMINAL / "run1.BIN", NOMINAL / "run4.BIN")
    code, _, err = run_program("diagnose", *runs, "--vehicle", vehicle, "--out", tmp_path / "report")
    assert code == 0, err
    assert engine.given["settings"].spread == tolerances_of(load(vehicle))
    assert engine.given["settings"].spread.lag == 0.015


def test_plan_is_made_with_them(engine: Engine, run_program: RunProgram, vehicle: Path) -> None:
    assert run_program("plan", "--vehicle", vehicle, "--sweep", "150@2.4").code == 0
    assert engine.given["spread"] == tolerances_of(load(vehicle))
    assert engine.given["spread"].lag == 0.015
