"""An effect of a variant shows in the recording of the plant where its definition says."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.redrive.recorded_course import course_of
from sitl.plant.variant import load_variant
from sitl.redrive.open_loop import redrive

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
        "trim": "steering_trim = { u0 = 0.03 }",
        "late": "clock_offset = { T = 0.04 }",
        "lagging": 'clock_offset = { T = 0.04, stream = "velocity" }',
    }.items():
        (folder / "v.toml").write_text(QUIET + effect)
        redrive(course, load_variant(folder / "v.toml"), folder / "out.BIN")
        (run,) = read_runs(str(folder / "out.BIN"))
        found[name] = {c: run[c].on(GRID) for c in ("r", "p", "ay", "pwm", "vy", "speed")}
    return found


def test_imu_offset_adds_its_share_of_yaw_acceleration(
    driven: Mapping[str, Mapping[str, np.ndarray]],
) -> None:
    plain, offset = driven["plain"], driven["offset"]
    turning = np.gradient(plain["r"], GRID)
    more = offset["ay"] - plain["ay"]
    share = float(np.dot(more, turning) / np.dot(turning, turning))
    assert share == pytest.approx(0.06, rel=0.05)
    assert offset["r"] == pytest.approx(plain["r"], abs=1e-9)


def test_trim_turns_the_mean_path(driven: Mapping[str, Mapping[str, np.ndarray]]) -> None:
    plain, trim = driven["plain"], driven["trim"]
    more = np.mean(trim["r"] - plain["r"])
    assert more == pytest.approx(-0.03 * np.mean(plain["speed"]) / 0.391, rel=0.06)


def test_another_clock_stamps_the_steering_late_and_nothing_else(
    driven: Mapping[str, Mapping[str, np.ndarray]],
) -> None:
    plain, late = driven["plain"], driven["late"]
    assert late["r"] == pytest.approx(plain["r"], abs=1e-9)
    assert late["pwm"][4:] == pytest.approx(plain["pwm"][:-4], abs=1e-6)


def test_a_late_velocity_stream_moves_the_velocity_alone(
    driven: Mapping[str, Mapping[str, np.ndarray]],
) -> None:
    plain, late = driven["plain"], driven["lagging"]
    assert late["pwm"] == pytest.approx(plain["pwm"])
    assert late["speed"][4:] == pytest.approx(plain["speed"][:-4], abs=1e-3)
