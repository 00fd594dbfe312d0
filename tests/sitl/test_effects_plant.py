"""Effects in tyres, road and sensors, against their definitions; none of them: as before.

tests/diagnosis/test_augmented_variant.py compares all effects with models that share no code with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import atan, cos, exp, pi, sin, sqrt, tanh
from pathlib import Path

import numpy as np
import pytest

from sitl.autopilot.rover import Rover
from sitl.autopilot.vehicle_parameters import ParameterStore
from sitl.plant.effects.imu import Delayed, FirstOrder
from sitl.plant.effects.tyres import Stiffness, brush, peaked, yielding
from sitl.plant.plant import GRAVITY, Plant
from sitl.plant.sensors import GpsFix, LowPassFilter2p, Sensors
from sitl.plant.servo import Servo
from sitl.plant.variant import PlantParameters, load_variant

NOMINAL = load_variant("nominal")
SMOOTH = replace(
    NOMINAL, road_force=0.0, road_yaw_moment=0.0, road_roll_moment=0.0, friction=50.0, rolling_resistance=0.0
)
DT = 0.0025
Effects = Mapping[str, Mapping[str, float]]

# x, y, psi, r, phi, delta half-way and at the end of `motion`
GOLDEN_MIDDLE = (
    12.457764252549719, -0.4537778908091289, 0.03520653929416928, 0.8846899538214996,
    0.025412745482896994, 0.09779098389517615,
)  # fmt: skip
GOLDEN_END = (
    19.88832291444417, -0.5573719731035037, -0.029469353802528332, 0.12520179122359998,
    0.003593313325199203, 0.1712416682533223,
)  # fmt: skip

ABSENT: Effects = {
    "steering_deadband": {"w": 0.0},
    "steering_backlash": {"b": 0.0},
    "steering_stiction": {"s": 0.0},
    "steering_nonlinearity": {"c3": 0.0},
    "steering_asymmetry": {"e": 0.0},
    "steering_trim": {"u0": 0.0},
    "tyre_relaxation": {"sigma": 0.0},
    "load_transfer": {"k": 0.0},
    "tyre_speed": {"k": 0.0},
    "roll_steer": {"e": 0.0},
    "suspension_friction": {"T": 0.0},
    "speed_variation": {"D": 0.0},
    "steering_compliance": {"k": 0.0},
    "yaw_damping": {"c": 0.0},
    "side_wind": {"w": 0.0, "psi0": 1.0},
    "sensor_scale": {"gyro": 0.0},
    "imu_offset": {"x": 0.0, "z": 0.0},
    "imu_tilt": {"roll": 0.0},
    "surface_change": {"ratio": 1.0, "t": 3.0},
    "cross_slope": {"b": 0.0, "psi0": 1.0},
}


def with_effects(effects: Effects, base: PlantParameters = SMOOTH) -> PlantParameters:
    return replace(base, effects=effects)


def driven(plant: Plant, seconds: float, steer_us: float = 1500, throttle_us: float = 1700) -> Plant:
    for _ in range(round(seconds / DT)):
        plant.step(steer_us, throttle_us, DT)
    return plant


def motion(parameters: PlantParameters) -> list[tuple[float, ...]]:
    plant, sensors = Plant(parameters, 3), Sensors(parameters, 3)
    rows: list[tuple[float, ...]] = []
    for k in range(4000):
        plant.step(1500 + 200 * sin(0.02 * k) * (k > 1000), 1710 if 200 < k < 3500 else 1500, DT)
        sensors.update(plant.state)
        s = plant.state
        rows.append((s.x, s.y, s.psi, s.r, s.phi, s.delta, *sensors.gyro, *sensors.accel, *sensors.velocity))
    return rows


def test_without_effects_the_nominal_rover_moves_as_it_did_before_there_were_any() -> None:
    """Numbers of the plant as it was when it knew of no effects (1e-9: libraries differ in the last bit)."""
    rows = motion(NOMINAL)
    assert rows[2500][:6] == pytest.approx(GOLDEN_MIDDLE, rel=1e-9)
    assert rows[-1][:6] == pytest.approx(GOLDEN_END, rel=1e-9)


def test_effects_of_no_size_change_not_one_bit() -> None:
    assert motion(with_effects(ABSENT, NOMINAL)) == motion(NOMINAL)


def steady_turn(effects: Effects, steer_us: float = 1440, throttle_us: float = 1690) -> Plant:
    return driven(driven(Plant(with_effects(effects)), 4.0, 1500, throttle_us), 8.0, steer_us, throttle_us)


def axle_slips(plant: Plant) -> tuple[float, float]:
    q, s = plant.parameters, plant.state
    return (
        np.arctan2(s.vy + q.cg_to_front_axle * s.r, s.vx) - s.delta,
        np.arctan2(s.vy - q.cg_to_rear_axle * s.r, s.vx),
    )


def axle_forces(plant: Plant) -> tuple[float, float]:
    """From the balance of a steady turn: F_f cos(delta) + F_r = m V r, a F_f cos(delta) = b F_r."""
    q, s = plant.parameters, plant.state
    total, wheelbase = q.mass * s.vx * s.r, q.cg_to_front_axle + q.cg_to_rear_axle
    return total * q.cg_to_rear_axle / wheelbase / cos(s.delta), total * q.cg_to_front_axle / wheelbase


def test_tyre_saturation_follows_the_hyperbolic_tangent_of_the_static_load() -> None:
    mu = 0.5
    plant = steady_turn({"tyre_saturation": {"mu": mu}}, 1340)
    q = plant.parameters
    wheelbase = q.cg_to_front_axle + q.cg_to_rear_axle
    loads = (
        q.mass * GRAVITY * q.cg_to_rear_axle / wheelbase,
        q.mass * GRAVITY * q.cg_to_front_axle / wheelbase,
    )
    stiffnesses = (q.front_cornering_stiffness, q.rear_cornering_stiffness)
    for force, slip, c, load in zip(axle_forces(plant), axle_slips(plant), stiffnesses, loads, strict=True):
        assert force == pytest.approx(-mu * load * tanh(c * slip / (mu * load)), rel=0.01)
        assert abs(force) < 0.95 * abs(c * slip)


# ---- Forms of the plant's effects, and effects in body, road and sensors, by their definitions.

EVEN = replace(NOMINAL, road_force=0.0, road_yaw_moment=0.0, road_roll_moment=0.0)
QUIET = replace(EVEN, gyro_noise=0.0, accel_noise=0.0, vibration=0.0, attitude_error=0.0, velocity_error=0.0)
Forms = Mapping[str, Mapping[str, float | str]]


@pytest.mark.parametrize("slip", [-3.0, -0.5, -0.05, 0.0, 0.3])
def test_tyre_forms(slip: float) -> None:
    """Only the last form falls beyond its peak."""
    stiffness, peak = 60.0, 8.0
    z = stiffness * abs(slip) / peak
    by_brush = peak * (z - z**2 / 3 + z**3 / 27) if z < 3 else peak
    assert brush(slip, stiffness, peak, 1.3) == pytest.approx(-np.sign(slip) * by_brush)
    falling = peak * sin(1.6 * atan(z / 1.6))
    assert peaked(slip, stiffness, peak, 1.3) == pytest.approx(-np.sign(slip) * falling)


@pytest.mark.parametrize("law", [brush, peaked])
@pytest.mark.parametrize("slip", [-0.2, 0.02, 0.15])
def test_a_soft_steering_balances_the_force(law: object, slip: float) -> None:
    assert callable(law)
    force = yielding(law, slip, 60.0, 8.0, 1.3, 0.01)
    assert force == pytest.approx(law(slip + 0.01 * force, 60.0, 8.0, 1.3), rel=1e-6)
    assert abs(force) < abs(law(slip, 60.0, 8.0, 1.3))


def test_a_change_of_ground_over_ten_seconds_and_one_all_along() -> None:
    slow = Stiffness({"surface_change": {"ratio": 0.5, "t": 5.0, "form": "over ten seconds"}})
    drift = Stiffness({"surface_change": {"ratio": 0.5, "form": "all along"}})
    found = []
    for t in (4.0, 10.0, 15.0, 300.0):
        slow.travel(0.0, t)
        drift.travel(0.0, t)
        found.append((slow.surface, drift.surface))
    assert [a for a, _ in found] == pytest.approx([1.0, 0.5**0.5, 0.5, 0.5])
    assert [b for _, b in found] == pytest.approx([0.5 ** (t / 300) for t in (4.0, 10.0, 15.0, 300.0)])


def test_first_order_and_delay_by_their_steps() -> None:
    lag, late = FirstOrder(400.0, 5.0), Delayed(400.0, 5.0)
    lag.apply(0.0)
    late.apply(0.0)
    rows = np.array([(lag.apply(1.0), late.apply(k + 1.0)) for k in range(60)])
    assert rows[19, 0] == pytest.approx(1 - exp(-20 / 400 * 2 * pi * 5))
    assert rows[-1, 1] == pytest.approx(60 - 400 / (2 * pi * 5))


def turned(effects: Forms) -> Sensors:
    """Sensors after a steady turn to the left."""
    parameters = replace(QUIET, effects=effects)
    plant, sensors = Plant(parameters), Sensors(parameters)
    for _ in range(3000):
        plant.step(1440, 1690, DT)
        sensors.update(plant.state)
    return sensors


def test_scales_of_the_sensors() -> None:
    plain, scaled = turned({}), turned({"sensor_scale": {"gyro": 0.1, "accel": -0.05}})
    assert scaled.gyro[2] - plain.gyro[2] == pytest.approx(
        0.1 * (plain.gyro[2] - QUIET.gyro_bias[2]), rel=1e-6
    )
    own = plain.accel[1] - QUIET.accel_bias[1]
    assert scaled.accel[1] - plain.accel[1] == pytest.approx(-0.05 * own, rel=1e-6)


@pytest.mark.parametrize(("form", "lag"), [("first order", 1.0), ("second order", 2**0.5)])
def test_a_filter_before_the_estimator_holds_the_heading_back(form: str, lag: float) -> None:
    """In a steady turn by r times the filter's lag at low frequency."""
    own = {"gyro_hz": 4.0}
    behind = turned({"sensor_filter": {**own, "form": form}})
    early = turned({"sensor_filter": {**own, "form": f"{form}, before the estimator"}})
    yaw_rate = -(early.gyro[2] - QUIET.gyro_bias[2])
    assert early.attitude[2] - behind.attitude[2] == pytest.approx(yaw_rate * lag / (2 * pi * 4.0), rel=0.05)
    assert early.gyro == behind.gyro


# ---- Effects between command and road wheel, against their definitions.

QUICK = replace(NOMINAL, servo_lag=0.0, servo_delay=0.0, servo_rate_limit=1e6)


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
    before = servo({"steering_trim": {"u0": 0.04}}, quick=False)  # there before the first pulse
    assert held(before, 0.0, 0.1) == pytest.approx(-0.04)


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
    effects = {"steering_deadband": {"w": 0.02}}  # it lags on what is left of the error
    slow = Servo(replace(NOMINAL, servo_delay=0.0, servo_rate_limit=1e6, effects=effects))
    slow.command(1500 - 0.2 / NOMINAL.rad_per_us, 0.0)
    assert slow.advance(0.0, 0.03) == pytest.approx(0.18 * (1 - exp(-0.03 / NOMINAL.servo_lag)))


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


# ---- Forms in the sensors and the clocks, against their definitions.


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


def sampled(effects: Forms, w: float, seconds: float) -> np.ndarray:
    """Rows (t, gyro, accel, velocity, attitude), FRD, of a sine of 60 us at w [rad/s] from 4 s on."""
    q = replace(CLEAN, effects=effects)
    plant, sensors = Plant(q), Sensors(q, gyro_filter_hz=0.0, accel_filter_hz=0.0)
    rows = []
    for k in range(round((4 + seconds) / DT)):
        plant.step(1500 - 60 * sin(w * (k * DT - 4)) * (k * DT > 4), 1700, DT)
        sensors.update(plant.state)
        rows.append((plant.state.t, *sensors.gyro, *sensors.accel, *sensors.velocity, *sensors.attitude))
    return np.array(rows[round(4 / DT) :])


def ratio(effects: Forms, w: float) -> np.ndarray:
    """Complex amplitudes at w of gyro, accel (FRD) and velocity with effects over those without."""
    seconds = 2 * pi / w * round(6 * w / (2 * pi))
    with_it, without = (sampled(e, w, 2 * seconds)[-round(seconds / DT) :, 1:10] for e in (effects, {}))
    turn = np.exp(-1j * w * DT * np.arange(len(with_it)))[:, None]
    moving = [k for k in range(9) if np.ptp(without[:, k]) > 0]
    found = np.full(9, np.nan, complex)
    found[moving] = np.sum((with_it * turn)[:, moving], 0) / np.sum((without * turn)[:, moving], 0)
    return found


def test_hidden_filters_are_second_order_butterworth_and_velocity_lag_is_first_order() -> None:
    w = 10.0

    def wanted(hz: float) -> complex:
        s = 1j * w / (2 * pi * hz)
        return 1 / (1 + sqrt(2) * s + s * s)

    found = ratio({"sensor_filter": {"gyro_hz": 6.0, "accel_hz": 12.0}}, w)
    assert found[[0, 2]] == pytest.approx(wanted(6.0), abs=0.01)
    assert found[4] == pytest.approx(wanted(12.0), abs=0.01)
    found = ratio({"velocity_lag": {"T": 0.1}}, w)
    assert found[[0, 2, 3, 4]] == pytest.approx(1.0)
    assert found[7] == pytest.approx(1 / (1 + 0.1j * w), abs=0.015)


def test_a_rolled_imu_reads_gravity_to_the_left() -> None:
    """+g sin(roll) in ISO axes, so minus that to the right; the attitude says the same."""
    row = sampled({"imu_tilt": {"roll": 0.05}}, 1.0, 0.0 + 2 * DT)[0]
    assert -row[5] == pytest.approx(GRAVITY * sin(0.05), rel=1e-3)
    assert row[10] == pytest.approx(0.05, abs=1e-3)


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


# ---- Sensors: consistent with the motion that they measure, in ArduPilot's axes, with its filter.

RATE = 400.0
PURE: dict[str, float | tuple[float, float, float]] = {
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
    return replace(NOMINAL, **{**PURE, **changes})  # type: ignore[arg-type]


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
