"""A recording of the real firmware driven again through the plant: the same motion, the same parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from rover_sweep.api.read import Reading, load_steered
from rover_sweep.cli.main import run
from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import load as load_vehicle
from rover_sweep.data.vehicle_geometry import geometry_of
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.pipeline import Identification, identify
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.redrive.recorded_course import course_of, grown
from sitl.plant.plant import Plant
from sitl.plant.variant import load_variant
from sitl.redrive.open_loop import redrive


@pytest.fixture(scope="module")
def again(data: Path, truth: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("redrive") / "again.BIN"
    source = data / "ardurover-4.6.3" / "nominal" / "run1.BIN"
    assert run(["redrive", str(source), "--variant", str(truth), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def both(data: Path, again: Path) -> tuple[Recording, Recording]:
    (field,), (simulated,) = read_runs(str(data / "ardurover-4.6.3/nominal/run1.BIN")), read_runs(str(again))
    return field, simulated


def test_the_recording_is_on_the_clock_of_the_log(both: tuple[Recording, Recording]) -> None:
    field, simulated = both
    assert simulated.span == pytest.approx(field.span, abs=1e-6)
    assert (simulated.kind, simulated.filters) == (field.kind, field.filters)
    t = np.arange(*field.span, 0.01)
    assert simulated["pwm"].on(t) == pytest.approx(field["pwm"].on(t), abs=1.001)  # 1 us, rounded
    assert abs(simulated.mean_speed - field.mean_speed) < 0.005


@pytest.mark.parametrize("channel", ["r", "ay"])
def test_responses_agree_within_the_noise_of_both(both: tuple[Recording, Recording], channel: str) -> None:
    """The noise of straight driving, of both recordings together, and 3 % of the response itself: the
    estimator's speed, which is followed, is 1.4 % lower than the true one of that recording."""
    field, simulated = both
    t = np.arange(*field.span, 0.01)
    difference = np.std(field[channel].on(t) - simulated[channel].on(t))
    noise = [
        np.mean([np.std(one[channel].between(*part).x) for part in one.straight])
        for one in (field, simulated)
    ]
    signal = np.std(field[channel].on(t))
    assert difference < np.hypot(1.15 * np.hypot(*noise), 0.03 * signal)
    assert difference < 0.25 * signal, "and it is not all noise"


def identified(source: Path, data: Path) -> Identification:
    """One C for both axles in both: with the axles apart in one of them alone, C is another quantity."""
    vehicle = load_vehicle(data / "rover.toml")
    runs = load_steered([str(source)], vehicle, Reading())
    return identify(runs, geometry_of(vehicle), settings=Settings(models=("roll-yaw",), as_paper=True))


def test_identification_gives_the_same_parameters(data: Path, again: Path) -> None:
    """Within the Cramer-Rao bound of the recording: another noise moves Izz by 4 % (standard deviation)."""
    field, simulated = (
        identified(source, data).models["roll-yaw"].fit
        for source in (data / "ardurover-4.6.3/nominal/run1.BIN", again)
    )
    for name in ("C", "Izz", "k_phi", "tau"):
        bound = 0.01 * (field[name].cr_percent or 0.0)
        assert 0.0 < bound < 0.13, name
        assert simulated[name].value == pytest.approx(field[name].value, rel=bound), name


# ---- An effect of a variant shows in the recording of the plant where its definition says.

QUIET = """base = "nominal"
friction = 4.0
road_force = 0.0
road_yaw_moment = 0.0
road_roll_moment = 0.0
gyro_noise = 0.0
accel_noise = 0.0
vibration = 0.0
[effects]
"""
GRID = np.arange(138.0, 150.0, 0.01)


@pytest.fixture(scope="module")
def driven(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Mapping[str, np.ndarray]]:
    """Channels on GRID of the doublets of the applet's recording, plain and with effects."""
    folder = tmp_path_factory.mktemp("effects")
    (log,) = read_logs(str(data / "ardurover-4.6.3" / "applet" / "run2.BIN"))
    course, found = course_of(log), {}
    for name, effect in {
        "plain": "",
        "offset": "imu_offset = { x = 0.06 }",
        "late": "clock_offset = { T = 0.04 }",
    }.items():
        (folder / "v.toml").write_text(QUIET + effect)
        redrive(course, load_variant(folder / "v.toml"), folder / "out.BIN")
        (run,) = read_runs(str(folder / "out.BIN"))
        found[name] = {c: run[c].on(GRID) for c in ("r", "ay", "pwm")}
    return found


def test_imu_offset_adds_its_share_of_yaw_acceleration(driven):
    plain, offset = driven["plain"], driven["offset"]
    turning = np.gradient(plain["r"], GRID)
    more = offset["ay"] - plain["ay"]
    share = float(np.dot(more, turning) / np.dot(turning, turning))
    assert share == pytest.approx(0.06, rel=0.05)
    assert offset["r"] == pytest.approx(plain["r"], abs=1e-9)


def test_another_clock_stamps_the_steering_late_and_nothing_else(driven):
    plain, late = driven["plain"], driven["late"]
    assert late["r"] == pytest.approx(plain["r"], abs=1e-9)
    assert late["pwm"][4:] == pytest.approx(plain["pwm"][:-4], abs=1e-6)


# ---- The nominal rover at another mass keeps its motion: rates and accelerations, frequencies, limits.

NOMINAL = load_variant("nominal")
SIZES = ("mass", "sprung_mass", "cg_height_above_roll_centre", "yaw_inertia", "roll_inertia")


def _size(mass: float) -> dict[str, float]:
    return {name: getattr(NOMINAL, name) for name in SIZES} | {
        name: getattr(NOMINAL, name) * mass for name in ("mass", "sprung_mass", "yaw_inertia", "roll_inertia")
    }


def _yaw_and_roll(rover) -> np.ndarray:
    plant, out = Plant(rover, 1), []
    plant.state.vx = 2.0
    for k in range(600):
        plant.step(1500.0 + (120.0 if k > 200 else 0.0), 1700.0, 0.005)
        out.append((plant.state.r, plant.state.phi))
    return np.array(out)


def test_twenty_times_the_mass_moves_alike():
    heavy = grown(NOMINAL, _size(20.0))
    assert heavy.front_cornering_stiffness == pytest.approx(20.0 * NOMINAL.front_cornering_stiffness)
    one, two = _yaw_and_roll(NOMINAL), _yaw_and_roll(heavy)
    assert np.abs(one).max() > 0.1
    assert np.abs(one - two).max() < 0.02 * np.abs(one).max()


def test_a_rover_of_nearly_the_same_mass_stays():
    assert grown(NOMINAL, _size(1.05)) == NOMINAL
