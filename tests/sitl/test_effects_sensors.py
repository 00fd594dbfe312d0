"""Effects in the sensors and the clocks, against their definitions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import cos, pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest

from sitl.autopilot.rover import Rover
from sitl.autopilot.vehicle_parameters import ParameterStore
from sitl.plant.plant import GRAVITY, Plant
from sitl.plant.sensors import Sensors
from sitl.plant.variant import PlantParameters, load_variant

ZERO = (0.0, 0.0, 0.0)
CLEAN = replace(
    load_variant("nominal"),
    gyro_noise=0.0,
    accel_noise=0.0,
    vibration=0.0,
    gyro_bias=ZERO,
    accel_bias=ZERO,
    road_force=0.0,
    road_yaw_moment=0.0,
    road_roll_moment=0.0,
    velocity_error=0.0,
    attitude_error=0.0,
    velocity_lag=0.0,
)
DT = 0.0025
Effects = Mapping[str, Mapping[str, float | str]]


def sampled(effects: Effects, w: float, seconds: float) -> np.ndarray:
    """Rows (t, gyro, accel, velocity, attitude), FRD, of a sine of 60 us at w [rad/s] from 4 s on."""
    q = replace(CLEAN, effects=effects)
    plant, sensors = Plant(q), Sensors(q, gyro_filter_hz=0.0, accel_filter_hz=0.0)
    rows = []
    for k in range(round((4 + seconds) / DT)):
        plant.step(1500 - 60 * sin(w * (k * DT - 4)) * (k * DT > 4), 1700, DT)
        sensors.update(plant.state)
        rows.append((plant.state.t, *sensors.gyro, *sensors.accel, *sensors.velocity, *sensors.attitude))
    return np.array(rows[round(4 / DT) :])


def ratio(effects: Effects, w: float) -> np.ndarray:
    """Complex amplitudes at w of gyro, accel (FRD) and velocity with effects over those without."""
    seconds = 2 * pi / w * round(6 * w / (2 * pi))
    with_it, without = (sampled(e, w, 2 * seconds)[-round(seconds / DT) :, 1:10] for e in (effects, {}))
    turn = np.exp(-1j * w * DT * np.arange(len(with_it)))[:, None]
    moving = [k for k in range(9) if np.ptp(without[:, k]) > 0]
    found = np.full(9, np.nan, complex)
    found[moving] = np.sum((with_it * turn)[:, moving], 0) / np.sum((without * turn)[:, moving], 0)
    return found


@pytest.mark.parametrize("w", [10.0, 20.0])
def test_hidden_filters_are_second_order_butterworth(w: float) -> None:
    def wanted(hz: float) -> complex:
        s = 1j * w / (2 * pi * hz)
        return 1 / (1 + sqrt(2) * s + s * s)

    found = ratio({"sensor_filter": {"gyro_hz": 6.0, "accel_hz": 12.0}}, w)
    assert found[[0, 2]] == pytest.approx(wanted(6.0), abs=0.01)
    assert found[4] == pytest.approx(wanted(12.0), abs=0.01)
    only_gyro = ratio({"sensor_filter": {"gyro_hz": 6.0}}, w)
    assert only_gyro[4] == pytest.approx(1.0, abs=1e-6)


def test_velocity_lag_is_first_order_and_touches_nothing_else() -> None:
    w = 8.0
    found = ratio({"velocity_lag": {"T": 0.1}}, w)
    assert found[[0, 2, 3, 4]] == pytest.approx(1.0)
    assert found[7] == pytest.approx(1 / (1 + 0.1j * w), abs=0.015)


def test_a_rolled_imu_reads_gravity_to_the_left() -> None:
    """+g sin(roll) in ISO axes, so minus that to the right; the attitude says the same."""
    row = sampled({"imu_tilt": {"roll": 0.05}}, 1.0, 0.0 + 2 * DT)[0]
    assert -row[5] == pytest.approx(GRAVITY * sin(0.05), rel=1e-3)
    assert row[10] == pytest.approx(0.05, abs=1e-3)


def test_tilt_mixes_axes_about_the_axis_it_turns_about() -> None:
    """ISO: nose down by theta, p reads p cos - r sin; to the left by chi, a_y reads a_y cos - a_x sin."""
    plain = sampled({}, 6.0, 2.0)
    p, r, ax, ay = plain[:, 1], -plain[:, 3], plain[:, 4], -plain[:, 5]
    pitched = sampled({"imu_tilt": {"pitch": 0.1}}, 6.0, 2.0)
    assert pitched[:, 1] == pytest.approx(p * cos(0.1) - r * sin(0.1), abs=0.03 * np.max(np.abs(r)) * 0.1)
    assert np.mean(pitched[:, 4]) == pytest.approx(np.mean(ax) - GRAVITY * sin(0.1), abs=0.02)
    yawed = sampled({"imu_tilt": {"yaw": 0.1}}, 6.0, 2.0)
    assert -yawed[:, 5] == pytest.approx(ay * cos(0.1) - ax * sin(0.1), abs=1e-9)


@pytest.mark.parametrize(
    ("effect", "late"),
    [
        ({"T": 0.04}, {"SWEP": 40_000, "RCOU": 40_000, "XKF1": 0, "IMU": 0}),
        ({"T": -0.02, "stream": "velocity"}, {"SWEP": 0, "RCOU": 0, "XKF1": -20_000, "IMU": 0}),
    ],
)
def test_a_positive_offset_stamps_its_stream_late(
    tmp_path: Path, effect: Mapping[str, float | str], late: Mapping[str, int]
) -> None:
    plant: PlantParameters = replace(CLEAN, effects={"clock_offset": effect})
    rover = Rover(tmp_path, plant, 1, ParameterStore(tmp_path / "parameters.txt"))
    rover.now_us = 5_000_000
    assert {name: rover.log.stamp(name) - rover.now_us for name in late} == late
