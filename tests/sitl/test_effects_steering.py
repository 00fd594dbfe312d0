"""Effects between command and road wheel, against their definitions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import cos, exp, pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest

from sitl.autopilot.rover import Rover
from sitl.autopilot.vehicle_parameters import ParameterStore
from sitl.plant.plant import GRAVITY, Plant
from sitl.plant.sensors import Sensors
from sitl.plant.servo import Servo
from sitl.plant.variant import PlantParameters, load_variant

NOMINAL = load_variant("nominal")
QUICK = replace(NOMINAL, servo_lag=0.0, servo_delay=0.0, servo_rate_limit=1e6)
DT = 0.0025


def servo(effects: Mapping[str, Mapping[str, float]], quick: bool = True) -> Servo:
    return Servo(replace(QUICK if quick else NOMINAL, effects=effects))


def held(servo: Servo, u: float, seconds: float = 1.0, t: float = 0.0) -> float:
    """Road-wheel angle after u [rad] was commanded for a while."""
    for k in range(round(seconds / DT)):
        servo.command(1500 - u / NOMINAL.rad_per_us, t + k * DT)
        servo.advance(t + k * DT, t + (k + 1) * DT)
    return servo.angle


@pytest.mark.parametrize("u", [-0.3, -0.1, 0.05, 0.2])
def test_static_curves(u: float) -> None:
    assert held(servo({"steering_nonlinearity": {"c3": 2.0}}), u) == pytest.approx(u * (1 + 2 * u * u))
    side = 1.1 if u > 0 else 0.9
    assert held(servo({"steering_asymmetry": {"e": 0.1}}), u) == pytest.approx(side * u)
    assert held(servo({"steering_trim": {"u0": 0.04}}), u) == pytest.approx(u - 0.04)


def test_trim_is_there_before_the_first_pulse() -> None:
    assert held(servo({"steering_trim": {"u0": 0.04}}, quick=False), 0.0, 0.1) == pytest.approx(-0.04)


@pytest.mark.parametrize("quick", [True, False])
def test_backlash_is_the_play_operator(quick: bool) -> None:
    """Against the recursion on the servo's own motion without play."""
    loose, tight = servo({"steering_backlash": {"b": 0.012}}, quick), servo({}, quick)
    wheel, rows = 0.0, []
    for k in range(2000):
        u = 0.1 * sin(6 * k * DT) + 0.05 * sin(17 * k * DT)
        for s in (loose, tight):
            s.command(1500 - u / NOMINAL.rad_per_us, k * DT)
            s.advance(k * DT, (k + 1) * DT)
        wheel = min(max(wheel, tight.angle - 0.012), tight.angle + 0.012)
        rows.append((loose.angle, wheel, tight.angle))
    found, wanted, without = np.array(rows).T
    assert found == pytest.approx(wanted, abs=5e-4 if not quick else 1e-12)
    assert np.max(np.abs(found - without)) == pytest.approx(0.012, rel=1e-6)


def test_deadband_stops_short_of_the_target_from_either_side() -> None:
    s = servo({"steering_deadband": {"w": 0.02}}, quick=False)
    assert held(s, 0.015) == 0.0
    assert held(s, 0.2, t=1.0) == pytest.approx(0.18)
    assert held(s, 0.19, t=2.0) == pytest.approx(0.18)
    assert held(s, 0.1, t=3.0) == pytest.approx(0.12)


def test_deadband_lags_on_what_is_left_of_the_error() -> None:
    s = Servo(
        replace(NOMINAL, servo_delay=0.0, servo_rate_limit=1e6, effects={"steering_deadband": {"w": 0.02}})
    )
    s.command(1500 - 0.2 / NOMINAL.rad_per_us, 0.0)
    assert s.advance(0.0, 0.03) == pytest.approx(0.18 * (1 - exp(-0.03 / NOMINAL.servo_lag)))


def test_backlash_gain_and_phase_of_a_sine() -> None:
    """The describing function of play of half width b: (Gelb, Vander Velde 1968, table of nonlinearities)."""
    amplitude, b, w, n = 0.1, 0.02, 2 * pi, 4000
    s = servo({"steering_backlash": {"b": b}})
    rows = []
    for k in range(3 * n):
        s.command(1500 - amplitude * sin(2 * pi * k / n) / NOMINAL.rad_per_us, k / n)
        rows.append(s.advance(k / n, (k + 1) / n))
    turn = np.exp(-1j * w * np.arange(n) / n)
    found = 2j * np.mean(np.array(rows[-n:]) * turn) / amplitude
    share = 1 - 2 * b / amplitude
    real = (pi / 2 + np.arcsin(share) + share * np.sqrt(1 - share * share)) / pi
    imaginary = -4 * b / (pi * amplitude) * (1 - b / amplitude)
    assert found == pytest.approx(real + 1j * imaginary, abs=2e-3)


def test_full_travel_and_the_quadratic_curve() -> None:
    dead = {"steering_deadband": {"w": 0.02, "of": "command", "form": "full travel"}}
    assert held(servo(dead), 0.019) == 0.0
    assert held(servo(dead), -0.03) == pytest.approx(-0.03)
    bent = {"steering_nonlinearity": {"c3": 2.0, "form": "quadratic"}}
    assert held(servo(bent), -0.1) == pytest.approx(-0.1 * (1 + 2 * 0.3 * 0.1))


@pytest.mark.parametrize(
    ("form", "angles"),
    [
        ("no memory", (0.0, 0.03, 0.03, 0.055, 0.055, 0.02)),
        ("with memory", (0.0, 0.03, 0.04, 0.055, 0.055, 0.02)),
    ],
)
def test_stiction_holds_and_then_goes_all_the_way(form: str, angles: tuple[float, ...]) -> None:
    s = servo({"steering_stiction": {"s": 0.02, "form": form}})
    commanded = (0.015, 0.03, 0.04, 0.055, 0.045, 0.02)
    found = [held(s, u, 0.1, t=0.1 * k) for k, u in enumerate(commanded)]
    assert found == pytest.approx(angles)


def test_smooth_hysteresis_approaches_the_play_it_is_named_after() -> None:
    s = servo({"steering_backlash": {"b": 0.01, "form": "smooth hysteresis"}})
    assert held(s, 0.01) == pytest.approx(0.01 * exp(-1.0))
    assert held(s, 0.2, t=1.0) == pytest.approx(0.19, abs=1e-6)
    assert held(s, -0.2, t=2.0) == pytest.approx(-0.19, abs=1e-6)


def test_a_servo_of_second_order_overshoots_by_its_damping_and_keeps_its_rate_limit() -> None:
    q, lag = 1.5, 0.05
    damping = 1 / (2 * q**0.5)
    effects = {"servo_lag": {"T": lag, "q": q, "form": "second order"}}
    free = Servo(replace(QUICK, servo_lag=lag, effects=effects))
    free.command(1500 - 0.1 / NOMINAL.rad_per_us, 0.0)
    rows = np.array([free.advance(k * DT, (k + 1) * DT) for k in range(800)])
    assert max(rows) == pytest.approx(0.1 * (1 + exp(-pi * damping / (1 - damping**2) ** 0.5)), rel=2e-3)
    assert rows[-1] == pytest.approx(0.1, rel=1e-6)
    slow = Servo(replace(QUICK, servo_lag=lag, servo_rate_limit=0.2, effects=effects))
    slow.command(1500 - 0.1 / NOMINAL.rad_per_us, 0.0)
    rates = np.diff([slow.advance(k * DT, (k + 1) * DT) for k in range(800)]) / DT
    assert max(abs(rates)) == pytest.approx(0.2, rel=1e-6)


# ---- Effects in the sensors and the clocks, against their definitions.

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
