"""The exported Python file moves as the plant does, where nothing of this project can be imported."""

from __future__ import annotations

import ast
import csv
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sitl.plant.plant import Plant
from sitl.plant.variant import PlantParameters, load_variant
from sitl.redrive.course import Course
from sitl.redrive.open_loop import redrive
from sitl.twin.fmu_file import fmu_file
from sitl.twin.python_file import python_file

DT, STEPS = 0.0025, 1000
VARIANTS = {
    "effects": """base = "nominal"
[effects]
tyre_relaxation = { sigma = 0.25 }
steering_backlash = { b = 0.012 }
tyre_saturation = { mu = 0.7, form = "brush" }
roll_steer = { e = 0.1 }
imu_offset = { x = 0.1, z = 0.02 }
suspension_friction = { T = 0.1 }
surface_change = { ratio = 0.8, t = 2.0 }
cross_slope = { b = 0.03, psi0 = 0.5 }
servo_lag = { T = 0.05, q = 0.4, form = "second order" }
imu_tilt = { roll = 0.02 }
""",
    "table": """base = "nominal"
[effects]
steering_deadband = { w = 0.01 }
[[table_law]]
place = "yaw moment"
over = "r"
x = [-2.0, 0.0, 1.0]
y = [0.9, 0.0, -0.6]
[[table_law]]
place = "side force front"
over = "delta"
x = [-0.3, 0.3]
y = [-1.0, 1.0]
times = "a_y"
play = 0.02
""",
}
ALONE = """
import sys
for name in ("sitl", "rover_sweep", "firmware_params"):
    sys.modules[name] = None  # its import now fails
{numpy}
sys.path.insert(0, sys.argv[1])
from math import sin
import json
import rover_twin
rover = rover_twin.Rover({seed})
rows = [rover.step(1500 + 250 * sin(2.5 * k * {dt}), 1750, {dt}) for k in range({steps})]
print(json.dumps(rows))
"""
WITHOUT_NUMPY = 'sys.modules["numpy"] = None'


def parameters_of(text: str, folder: Path) -> PlantParameters:
    (folder / "variant.toml").write_text(text)
    return load_variant(folder / "variant.toml")


def even(q: PlantParameters) -> PlantParameters:
    return replace(q, road_force=0.0, road_yaw_moment=0.0, road_roll_moment=0.0)


def moved_alone(folder: Path, seed: int | None) -> np.ndarray:
    """(STEPS, 11) of the file rover_twin.py in the folder; on an even road without numpy."""
    words = {"seed": "" if seed is None else seed, "dt": DT, "steps": STEPS}
    code = ALONE.format(numpy=WITHOUT_NUMPY if seed is None else "", **words)
    done = subprocess.run([sys.executable, "-I", "-c", code, str(folder)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return np.array(json.loads(done.stdout))


def moved_by_the_plant(q: PlantParameters, seed: int) -> np.ndarray:
    plant, rows = Plant(q, seed), []
    s = plant.state
    for k in range(STEPS):
        plant.step(1500 + 250 * np.sin(2.5 * k * DT), 1750, DT)
        rows.append((s.t, s.x, s.y, s.psi, s.vx, s.vy, s.r, s.phi, s.p, s.ay, s.delta))
    return np.array(rows)


@pytest.mark.parametrize(("name", "seed"), [("effects", None), ("table", 1)])
def test_the_file_alone_moves_as_the_plant(name: str, seed: int | None, tmp_path: Path) -> None:
    q = parameters_of(VARIANTS[name], tmp_path)
    (tmp_path / "rover_twin.py").write_text(python_file(q, ["Numbers of a test."]))
    alone = moved_alone(tmp_path, seed)
    plant = moved_by_the_plant(q if seed else even(q), seed or 0)
    np.testing.assert_allclose(alone, plant, rtol=0, atol=1e-9)
    assert np.ptp(plant[:, 6]) > 0.5, "it turns"


def test_the_file_is_whole(tmp_path: Path) -> None:
    """Every name in it is defined once, and it imports only Python's own modules and numpy."""
    path, origin = tmp_path / "rover_twin.py", 'Numbers of a\\b""" + print(1) + """.toml'
    q = parameters_of(VARIANTS["effects"], tmp_path)
    path.write_text(python_file(q, [origin]))
    words = ["ruff", "check", "--isolated", "--select", "F,E9,A", str(path)]
    done = subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            module = node.module if isinstance(node, ast.ImportFrom) else node.names[0].name
            assert (module or "").partition(".")[0] in {*sys.stdlib_module_names, "numpy"}
    assert "print(1)" in (ast.get_docstring(tree) or "")
    assert "sensors only: imu_tilt." in path.read_text()


@pytest.fixture(scope="module")
def course() -> Course:
    t = 5.0 + np.arange(0.0, 12.0, 0.01)
    speed = np.clip(t - 6.0, 0.0, 2.5)
    steering = 1500 + np.where(t > 9.0, 200 * np.sin(4.0 * (t - 9.0)), 0.0)
    return Course(t, steering, speed, t, steering)


@pytest.fixture
def twin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The exported nominal rover as a module."""
    (tmp_path / "rover_twin.py").write_text(python_file(load_variant("nominal"), ["Numbers of a test."]))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "rover_twin", raising=False)
    import rover_twin  # type: ignore[import-not-found]

    yield rover_twin
    sys.modules.pop("rover_twin")


def test_a_recorded_drive_is_repeated_as_by_redrive(course: Course, twin, tmp_path: Path) -> None:
    speeds = redrive(course, load_variant("nominal"), tmp_path / "out.BIN", seed=1)
    motion = twin.Rover(seed=1).drive(course.t, course.steering, course.speed)
    np.testing.assert_allclose(motion["V_x"], speeds, rtol=0, atol=1e-9)
    assert speeds.max() > 2.3 and np.ptp(motion["r"]) > 0.5


def test_unusable_numbers_are_refused_and_long_steps_divided(twin) -> None:
    for t, speed, said in (
        ([0.0], [1.0], "of one length, 2 or more"),
        ([0.0, 0.1], [1.0], "of one length"),
        ([0.0, 0.2, 0.1], [1.0] * 3, "must ascend; it does not after 0.2 s"),
        ([0.0, 0.1], [1.0, np.nan], "not numbers"),
        ([0.0, 20.0], [1.0, 1.0], "a gap of 20 s"),
    ):
        with pytest.raises(ValueError, match=said):
            twin.Rover().drive(t, [1500.0] * len(t), speed)
    for dt in (0.0, np.nan):
        with pytest.raises(ValueError, match="is impossible"):
            twin.Rover().step(1500, 1600, dt)
    rover, other = twin.Rover(), twin.Rover()
    for _ in range(40):
        other.step(1600, 1700, 0.0025)
    assert rover.step(1600, 1700, 0.1) == pytest.approx(other.motion, abs=1e-9)


def command(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    words = (sys.executable, "-I", str(folder / "rover_twin.py"), *words)
    return subprocess.run(words, capture_output=True, text=True)


def test_the_file_drives_a_csv_file_or_refuses_it(twin, tmp_path: Path) -> None:
    t = np.arange(0.0, 10.0, 0.2)  # few samples keep their speed
    table = np.column_stack((t, 1500 + 100 * np.sin(t), np.full(t.size, 2.0)))
    source = tmp_path / "drive.csv"
    np.savetxt(source, table, delimiter=",", header="time,steering,speed", comments="")
    done = command(tmp_path, str(source))
    assert (done.returncode, done.stderr) == (0, "")
    with (tmp_path / "drive_motion.csv").open() as file:
        rows = list(csv.DictReader(file))
    expected = twin.Rover().drive(*table.T)
    np.testing.assert_allclose(expected["V_x"], 2.0, atol=0.1)
    for name, column in expected.items():
        np.testing.assert_allclose([float(row[name]) for row in rows], column, atol=1e-9)
    for text, said in (
        ("time,steer,speed\n0,1500,1\n", "lacks the columns steering"),
        ("time,steering,speed\n0,1500,1\n0.1,x,1\n", "line 3 has something that is not a number"),
        ("time,steering,speed\n", "of one length, 2 or more"),
    ):
        source.write_text(text)
        done = command(tmp_path, str(source))
        assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr


# ---- One file out of several modules does what the modules do: names are kept apart, the unused is left out.


# ---- The FMU of a rover, run by fmpy, moves as the plant does; skipped where pythonfmu or fmpy is missing.

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


def test_the_fmu_is_valid_and_describes_its_variables(built: dict[str, Path]) -> None:
    description = fmpy.read_model_description(str(built["effects"]), validate=True)
    kinds = {v.name: v.causality for v in description.modelVariables}
    assert {name for name, kind in kinds.items() if kind == "output"} == set(OUTPUTS)
    assert {n for n, kind in kinds.items() if kind == "input"} == {"steering_us", "throttle_us", "speed"}
    assert description.coSimulation.modelIdentifier == "rover_effects"
    assert {v.name: v.start for v in description.modelVariables}["steering_us"] == "1500"
    assert all(v.description for v in description.modelVariables)


def test_the_fmu_needs_neither_this_project_nor_numpy(built: dict[str, Path], tmp_path: Path) -> None:
    folder = Path(fmpy.extract(str(built["effects"]), str(tmp_path))) / "resources"
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
