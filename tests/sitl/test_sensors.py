"""Sensors: consistent with the motion that they measure, in ArduPilot's axes, with its filter."""

from __future__ import annotations

from dataclasses import replace
from math import cos, sin, sqrt

import numpy as np
import pytest

from sitl.plant.plant import GRAVITY, Plant
from sitl.plant.sensors import GpsFix, LowPassFilter2p, Sensors
from sitl.plant.variant import PlantParameters, load_variant

NOMINAL = load_variant("nominal")
RATE = 400.0
CLEAN: dict[str, float | tuple[float, float, float]] = {
    "gyro_noise": 0.0,
    "accel_noise": 0.0,
    "vibration": 0.0,
    "gyro_bias": (0.0, 0.0, 0.0),
    "accel_bias": (0.0, 0.0, 0.0),
    "road_force": 0.0,
    "road_yaw_moment": 0.0,
    "road_roll_moment": 0.0,
}


def clean(**changes: float | tuple[float, float, float]) -> PlantParameters:
    return replace(NOMINAL, **{**CLEAN, **changes})  # type: ignore[arg-type]


def body_to_ned(attitude: tuple[float, float, float]) -> np.ndarray:
    roll, pitch, yaw = attitude
    x = np.array([[1, 0, 0], [0, cos(roll), -sin(roll)], [0, sin(roll), cos(roll)]])
    y = np.array([[cos(pitch), 0, sin(pitch)], [0, 1, 0], [-sin(pitch), 0, cos(pitch)]])
    z = np.array([[cos(yaw), -sin(yaw), 0], [sin(yaw), cos(yaw), 0], [0, 0, 1]])
    return z @ y @ x


@pytest.mark.parametrize("imu", [(0.0, 0.0, 0.058), (0.3, 0.2, -0.4)])
def test_imu_is_the_motion_of_its_place(imu: tuple[float, float, float]) -> None:
    """Differentiating position and velocity at the IMU gives its velocity, acceleration and body rates."""
    rate = 2000.0
    q = clean(imu_position=imu)
    plant, sensors = Plant(q), Sensors(q, rate_hz=rate, gyro_filter_hz=0, accel_filter_hz=0)
    for _ in range(int(3 * rate)):
        plant.step(1500, 1750, 1 / rate)
    rows = []
    for k in range(int(2 * rate)):
        plant.step(1500 + 200 * sin(12 * k / rate), 1750, 1 / rate)
        sensors.update(plant.state)
        rows.append(
            (sensors.true_position, sensors.true_velocity, sensors.true_attitude, sensors.gyro, sensors.accel)
        )
    position, velocity, attitude, gyro, accel = (np.array(column) for column in zip(*rows, strict=True))
    middle = slice(1, None)
    assert np.diff(position, axis=0) * rate == pytest.approx((velocity[1:] + velocity[:-1]) / 2, abs=2e-3)

    turn = np.array([body_to_ned(tuple(a)) for a in attitude])
    specific = np.diff(velocity, axis=0) * rate - np.array([0, 0, GRAVITY])
    felt = np.einsum("nij,nj->ni", (turn[1:] + turn[:-1]) / 2, accel[middle])
    # mean force over the step against the difference of velocities: the same instant
    assert np.sqrt(np.mean((felt - specific) ** 2, axis=0)) == pytest.approx([0, 0, 0], abs=1e-4)
    assert np.ptp(specific[:, 1]) > 2.5, "the manoeuvre must be a lively one"

    change = np.einsum("nji,njk->nik", turn[:-1], turn[1:]) * rate  # R' dR = skew(w) dt
    rates = np.stack([change[:, 2, 1], change[:, 0, 2], change[:, 1, 0]], axis=1)
    assert rates == pytest.approx((gyro[1:] + gyro[:-1]) / 2, abs=0.01)


def test_right_turn_in_frd_axes() -> None:
    q = clean()
    plant, sensors = Plant(q), Sensors(q)
    for _ in range(2000):
        plant.step(1500 + 150, 1710, 1 / RATE)
        sensors.update(plant.state)
    assert sensors.gyro[2] > 0.5 and sensors.accel[1] > 1.0 and sensors.accel[2] < -9.0
    assert sensors.true_attitude[2] > 1.0 and sensors.true_position[1] != 0
    assert sensors.true_attitude[0] < 0, "the body leans out, to the left"


def test_filter_is_ardupilots_butterworth() -> None:
    """Against scipy's bilinear Butterworth, which the cut-off is warped for in the same way."""
    from scipy.signal import butter, lfilter

    x = np.random.default_rng(0).standard_normal(2000)
    filter_ = LowPassFilter2p(RATE, 20.0)
    filter_.apply(0.0)
    got = [filter_.apply(v) for v in x]
    assert got == pytest.approx(lfilter(*butter(2, 20.0, fs=RATE), x), abs=1e-9)


def test_filter_starts_at_the_first_sample_and_zero_passes() -> None:
    filter_ = LowPassFilter2p(RATE, 4.0)
    assert [filter_.apply(-9.8) for _ in range(5)] == pytest.approx([-9.8] * 5)
    assert LowPassFilter2p(RATE, 0.0).apply(3.0) == 3.0
    assert LowPassFilter2p(RATE, 1000.0).cutoff_hz == pytest.approx(0.4 * RATE)


@pytest.mark.parametrize("rate", [400.0, 1200.0])
def test_noise_density_does_not_depend_on_the_rate(rate: float) -> None:
    q = clean(gyro_noise=NOMINAL.gyro_noise, vibration=NOMINAL.vibration, gyro_bias=(0.01, 0.0, 0.0))
    plant, sensors = Plant(q), Sensors(q, rate_hz=rate, gyro_filter_hz=0, accel_filter_hz=0)
    plant.state.vx = 2.5
    gyro, accel = [], []
    for _ in range(6000):
        sensors.update(plant.state)
        gyro.append(sensors.gyro_raw[0])
        accel.append(sensors.accel_raw[1])
    scale = sqrt(rate / 1200.0)
    assert np.std(gyro) == pytest.approx(0.010 * scale, rel=0.05)
    assert np.std(accel) == pytest.approx(0.25 * scale, rel=0.05)
    assert np.mean(gyro) == pytest.approx(0.01, abs=1e-3)


def test_estimator_is_close_but_not_the_truth_and_gps_comes_late_at_5_hz() -> None:
    plant, sensors = Plant(NOMINAL), Sensors(NOMINAL)
    off = []
    fixes: list[tuple[float, GpsFix]] = []
    for k in range(int(40 * RATE)):
        plant.step(1500 + 100 * sin(0.01 * k), 1710, 1 / RATE)
        sensors.update(plant.state)
        off.append(np.subtract(sensors.velocity, sensors.true_velocity)[:2])
        if sensors.gps is not None and (not fixes or sensors.gps is not fixes[-1][1]):
            fixes.append((plant.state.t, sensors.gps))
    assert np.std(off, axis=0) == pytest.approx([0.03, 0.03], rel=0.4)
    received = np.array([t for t, _ in fixes])
    measured = np.array([fix.t for _, fix in fixes])
    assert np.diff(measured) == pytest.approx(np.full(len(fixes) - 1, 0.2), abs=0.004)
    assert received - measured == pytest.approx(np.full(len(fixes), 0.1), abs=0.004)


def test_same_seed_same_noise() -> None:
    def sample(seed: int) -> tuple[float, float, float]:
        plant, sensors = Plant(NOMINAL, seed), Sensors(NOMINAL, seed)
        plant.step(1500, 1500, 1 / RATE)
        sensors.update(plant.state)
        return sensors.gyro_raw

    assert sample(5) == sample(5) != sample(6)
