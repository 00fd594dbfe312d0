"""The FMU of a rover, run by fmpy, moves as the plant does; skipped where pythonfmu or fmpy is missing."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sitl.plant.plant import Plant
from sitl.plant.variant import PlantParameters, load_variant
from sitl.twin.fmu_file import fmu_file

pytest.importorskip("pythonfmu")
fmpy = pytest.importorskip("fmpy")

STEP, END = 0.01, 4.0
OUTPUTS = ("r", "p", "a_y", "V_x", "V_y", "phi", "psi", "x", "y", "delta")
EFFECTS = {"tyre_relaxation": {"sigma": 0.25}, "steering_backlash": {"b": 0.012}}
NOMINAL = replace(load_variant("nominal"), road_force=0.0, road_yaw_moment=0.0, road_roll_moment=0.0)
ROVERS = {"nominal": NOMINAL, "effects": replace(NOMINAL, effects=EFFECTS)}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("fmu")
    paths = {}
    for name, q in ROVERS.items():
        paths[name] = folder / f"rover_{name}.fmu"
        paths[name].write_bytes(fmu_file(q, ["Numbers of a test."], f"rover_{name}"))
    return paths


def steering(t: float) -> float:
    return 1500.0 + 250.0 * float(np.sin(2.5 * t))


def simulated(path: Path, **start: object) -> np.ndarray:
    """Outputs of the FMU by name, each step of STEP, from inputs held over each."""
    t = np.arange(0.0, END, STEP)
    fields = [(name, float) for name in ("time", "steering_us", "throttle_us", "speed")]
    inputs = np.zeros(t.size, dtype=fields)
    inputs["time"], inputs["steering_us"] = t, [steering(float(x)) for x in t]
    inputs["throttle_us"], inputs["speed"] = 1750.0, 2.0
    return fmpy.simulate_fmu(
        str(path), stop_time=END, step_size=STEP, output_interval=STEP, input=inputs, output=OUTPUTS,
        start_values=start,
    )  # fmt: skip


def driven(q: PlantParameters) -> np.ndarray:
    plant, rows = Plant(q), []
    s = plant.state
    for k in range(round(END / STEP)):
        for _ in range(4):
            plant.step(steering(k * STEP), 1750.0, STEP / 4)
        rows.append((s.r, s.p, s.ay, s.vx, s.vy, s.phi, s.psi, s.x, s.y, s.delta))
    return np.array(rows)


@pytest.mark.parametrize("name", ROVERS)
def test_the_fmu_moves_as_the_plant(name: str, built: dict[str, Path]) -> None:
    """Both FMUs run in one process, each with its own numbers."""
    found, expected = simulated(built[name]), driven(ROVERS[name])
    assert np.ptp(expected[:, 0]) > 0.5, "it turns"
    for k, output in enumerate(OUTPUTS):
        np.testing.assert_allclose(found[output][1:], expected[:, k], rtol=0, atol=1e-9, err_msg=output)


def test_the_fmu_keeps_a_speed(built: dict[str, Path]) -> None:
    assert simulated(built["nominal"], by_speed=True)["V_x"][-1] == pytest.approx(2.0, abs=0.02)


def test_the_fmu_is_valid_and_describes_its_variables(built: dict[str, Path]) -> None:
    description = fmpy.read_model_description(str(built["effects"]), validate=True)
    kinds = {v.name: v.causality for v in description.modelVariables}
    assert {name for name, kind in kinds.items() if kind == "output"} == set(OUTPUTS)
    assert {n for n, kind in kinds.items() if kind == "input"} == {"steering_us", "throttle_us", "speed"}
    assert description.coSimulation.modelIdentifier == "rover_effects"
    assert {v.name: v.start for v in description.modelVariables}["steering_us"] == "1500"
    assert all(v.description for v in description.modelVariables)


def test_the_fmu_needs_neither_this_project_nor_numpy(built: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(fmpy.extract(str(built["nominal"]), str(tmp_path))) / "resources"
    slave = (folder / "slavemodule.txt").read_text()
    code = f"""
import sys
for name in ("sitl", "rover_sweep", "numpy"):
    sys.modules[name] = None
sys.path.insert(0, {str(folder)!r})
import {slave} as slave
twin = slave.RoverTwin(instance_name="one")
twin.steering_us, twin.throttle_us = 1600.0, 1700.0
assert all(twin.do_step(0.01 * k, 0.01) for k in range(100))
assert twin.get_real([3])[0] < -0.1, twin.get_real([3])
assert not twin.do_step(1.0, float("nan"))
"""
    done = subprocess.run([sys.executable, "-I", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
