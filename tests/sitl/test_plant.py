"""The plant against what is known of it without it: equation (18), statics, conservation laws."""

from __future__ import annotations

from dataclasses import replace
from math import atan, cos, exp, radians, sin

import numpy as np
import pytest

from sitl.plant.motor import Motor
from sitl.plant.plant import GRAVITY, Plant, PlantParameters
from sitl.plant.servo import Servo
from sitl.plant.tyre import LOW_SPEED, lateral_force, slip_angle
from sitl.plant.variant import load_variant

NOMINAL = load_variant("nominal")
SMOOTH = {"road_force": 0.0, "road_yaw_moment": 0.0, "road_roll_moment": 0.0}
DT = 0.0025


def smooth(parameters: PlantParameters, **changes: float) -> PlantParameters:
    """Without road disturbance."""
    return replace(parameters, **{**SMOOTH, **changes})  # type: ignore[arg-type]


def drive(plant: Plant, seconds: float, steer_us: float, throttle_us: float, dt: float = DT) -> None:
    for _ in range(round(seconds / dt)):
        plant.step(steer_us, throttle_us, dt)


def equation_18(q: PlantParameters, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """A (4, 4) and B (4,) of x' = A x + B delta, x = [V_y, r, phi', phi]: equation (18), corrected, with the
    algebraic states (slip angles) put in."""
    m, ms, h = q.mass, q.sprung_mass, q.cg_height_above_roll_centre
    a, b = q.cg_to_front_axle, q.cg_to_rear_axle
    cf, cr = q.front_cornering_stiffness, q.rear_cornering_stiffness
    left = np.array(
        [
            [1, 0, -h * ms / m, 0],
            [0, q.yaw_inertia, q.roll_yaw_inertia, 0],
            [-h * ms, q.roll_yaw_inertia, q.roll_inertia + ms * h**2, 0],
            [0, 0, 0, 1],
        ]
    )
    slip_front, slip_rear = np.array([1 / speed, a / speed, 0, 0]), np.array([1 / speed, -b / speed, 0, 0])
    right = np.array(
        [
            [0, -speed, 0, 0],
            [0, 0, 0, 0],
            [0, h * ms * speed, -q.roll_damping, -q.roll_stiffness + ms * GRAVITY * h],
            [0, 0, 1, 0],
        ]
    )
    right[0] -= cf / m * slip_front + cr / m * slip_rear
    right[1] -= a * cf * slip_front - b * cr * slip_rear
    return np.linalg.solve(left, right), np.linalg.solve(left, np.array([cf / m, a * cf, 0, 0]))


def linearised(plant: Plant, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """A and B of the plant by central differences about straight driving at constant speed."""
    q = plant.parameters
    plant.step(
        q.steering_trim_us, q.throttle_trim_us + speed / q.speed_per_us, 1e-9
    )  # no drive force at `speed`

    def rates(x: np.ndarray, delta: float) -> np.ndarray:
        vy, r, p, phi = x
        _, vy_dot, r_dot, p_dot = plant.derivatives(speed, vy, r, phi, p, delta)
        return np.array([vy_dot, r_dot, p_dot, p])

    step = 1e-5
    columns = [(rates(step * e, 0) - rates(-step * e, 0)) / (2 * step) for e in np.eye(4)]
    zero = np.zeros(4)
    return np.array(columns).T, (rates(zero, step) - rates(zero, -step)) / (2 * step)


@pytest.mark.parametrize("variant", ["nominal", "paper", "slippery"])
@pytest.mark.parametrize(("speed", "ixz"), [(1.0, 0.0), (4.0, 0.004)])
def test_linearises_to_equation_18(variant: str, speed: float, ixz: float) -> None:
    # the front wheel's rolling resistance turns with the wheel (0.8 % of C): not in equation (18)
    q = smooth(load_variant(variant), rolling_resistance=0.0, roll_yaw_inertia=ixz)
    a, b = linearised(Plant(q), speed)
    wanted_a, wanted_b = equation_18(q, speed)
    assert a == pytest.approx(wanted_a, rel=1e-6, abs=1e-5)
    assert b == pytest.approx(wanted_b, rel=1e-6, abs=1e-5)


def kinetic_and_potential(q: PlantParameters, s: object) -> tuple[float, float]:
    """(energy, angular momentum about the reference point's vertical) from positions of the two masses."""
    vx, vy, r, phi, p = (getattr(s, name) for name in ("vx", "vy", "r", "phi", "p"))
    h, ms, mu = q.cg_height_above_roll_centre, q.sprung_mass, q.mass - q.sprung_mass
    sprung = np.array([vx + r * h * sin(phi), vy - h * cos(phi) * p, -h * sin(phi) * p])
    kinetic = 0.5 * ms * sprung @ sprung + 0.5 * mu * (vx**2 + vy**2)
    kinetic += 0.5 * q.roll_inertia * p**2 + 0.5 * q.yaw_inertia * r**2 + q.roll_yaw_inertia * p * r
    potential = 0.5 * q.roll_stiffness * phi**2 + ms * GRAVITY * h * cos(phi)
    return kinetic, potential


def test_conserves_energy_and_momentum_without_tyres() -> None:
    free = {"front_cornering_stiffness": 1e-12, "rear_cornering_stiffness": 1e-12, "rolling_resistance": 0.0}
    tall = {"sprung_mass": 1.8, "cg_height_above_roll_centre": 0.2, "roll_stiffness": 60.0}
    q = smooth(NOMINAL, **free, **tall, roll_damping=0.0, speed_lag=1e12, roll_yaw_inertia=0.003)
    plant = Plant(q)
    s = plant.state
    s.vx, s.vy, s.r, s.phi, s.p = 2.0, -0.7, 3.0, 0.4, 2.0
    before = kinetic_and_potential(q, s)

    def momentum() -> np.ndarray:
        """Linear momentum in the earth frame."""
        h, ms = q.cg_height_above_roll_centre, q.sprung_mass
        along = q.mass * s.vx + ms * s.r * h * sin(s.phi)
        across = q.mass * s.vy - ms * h * cos(s.phi) * s.p
        c, n = cos(s.psi), sin(s.psi)
        return np.array([along * c - across * n, along * n + across * c])

    start = momentum()
    for _ in range(10000):
        plant.step(1500, 1500, 2e-4)
    after = kinetic_and_potential(q, s)
    assert abs(after[1] - before[1]) > 0.05, "energy must have moved between the two forms"
    assert sum(after) == pytest.approx(sum(before), rel=5e-6)
    assert momentum() == pytest.approx(start, rel=1e-5)


@pytest.mark.parametrize("variant", ["nominal", "paper", "slippery"])
def test_a_parked_car_stays_parked(variant: str) -> None:
    plant = Plant(load_variant(variant))
    for k in range(2000):
        plant.step(1500 + 400 * sin(0.01 * k), 1500 + 15 * sin(0.003 * k), DT)
    s = plant.state
    assert (s.x, s.y, s.psi, s.vx, s.vy, s.r, s.phi) == (0, 0, 0, 0, 0, 0, 0)
    assert (s.ax, s.ay, s.az) == (0, 0, GRAVITY)
    assert abs(s.delta) > 0.05 and s.t == pytest.approx(5.0)


@pytest.mark.parametrize("variant", ["nominal", "paper", "slippery"])
@pytest.mark.parametrize("steer", [1500, 1800])
def test_comes_to_rest_and_stays_there(variant: str, steer: float) -> None:
    plant = Plant(load_variant(variant))
    drive(plant, 5.0, steer, 1700)
    drive(plant, 8.0, steer, 1500)
    s = plant.state
    place = (s.x, s.y, s.psi)
    drive(plant, 2.0, steer, 1500)
    assert (s.x, s.y, s.psi) == place and s.vx == 0


@pytest.mark.parametrize(("variant", "throttle"), [("nominal", 1530), ("paper", 1560)])
def test_no_chatter_at_walking_speed(variant: str, throttle: float) -> None:
    """At 0.2-0.6 m/s the tyre poles are fastest; the yaw rate must settle, not ring from step to step."""
    stiff = {"front_cornering_stiffness": 100.0, "rear_cornering_stiffness": 105.0}
    plant = Plant(smooth(load_variant(variant), **stiff))
    drive(plant, 8.0, 1350, throttle, dt=0.01)
    rates = []
    for _ in range(100):
        plant.step(1350, throttle, 0.01)
        rates.append(plant.state.r)
    assert plant.state.vx > 0.1
    assert np.ptp(rates) < 1e-4
    wheelbase = plant.parameters.cg_to_front_axle + plant.parameters.cg_to_rear_axle
    assert plant.state.r == pytest.approx(plant.state.vx * np.tan(plant.state.delta) / wheelbase, rel=0.03)


# ---- Tyre law: slope, limit, symmetry, standstill.


def test_the_tyre_has_its_slope_saturates_mildly_at_the_peak_and_is_odd() -> None:
    """At a quarter of the peak the loss is about 2 %."""
    forces = [lateral_force(radians(a), 31.0, 11.0, 1.3) for a in range(0, 91)]
    assert min(forces) >= -11.0 and min(forces) == pytest.approx(-11.0, rel=1e-3)
    assert lateral_force(-0.1, 31.0, 11.0, 1.3) == -lateral_force(0.1, 31.0, 11.0, 1.3)
    assert lateral_force(1e-6, 31.0, 11.0, 1.3) == pytest.approx(-31.0e-6, rel=1e-6)
    slip = 0.25 * 11.0 / 31.0
    assert 0.97 < -lateral_force(slip, 31.0, 11.0, 1.3) / (31.0 * slip) < 0.985


def test_slip_angle_is_exact_when_rolling_and_zero_at_rest() -> None:
    assert slip_angle(2.0, 0.1) == pytest.approx(atan(0.05))
    assert slip_angle(-2.0, 0.1) == pytest.approx(atan(0.05)), "going back, the force still opposes the slide"
    assert slip_angle(0.0, 0.0) == 0
    assert slip_angle(0.0, 0.03) == pytest.approx(atan(0.03 / LOW_SPEED))


# ---- Steering servo: delay, lag, rate limit, end stops, on any step.


def after(servo: Servo, pwm: float, seconds: float, dt: float) -> float:
    t = 0.0
    for _ in range(round(seconds / dt)):
        servo.command(pwm, t)
        servo.advance(t, t + dt)
        t += dt
    return servo.angle


@pytest.mark.parametrize("dt", [0.0005, 0.0025, 0.004])
def test_delay_then_first_order_lag(dt: float) -> None:
    q = replace(NOMINAL, servo_rate_limit=1e3)
    seconds = 0.06
    wanted = -100 * q.rad_per_us * (1 - exp(-(seconds - q.servo_delay) / q.servo_lag))
    assert after(Servo(q), 1600, seconds, dt) == pytest.approx(wanted, rel=1e-6)
    assert after(Servo(q), 1600, 0.012, dt) == 0


def test_rate_limit_holds_until_the_lag_asks_for_less() -> None:
    q = replace(NOMINAL, servo_rate_limit=2.0, servo_delay=0.0)
    target = -300 * q.rad_per_us
    knee = (abs(target) - 2.0 * q.servo_lag) / 2.0
    assert after(Servo(q), 1800, 0.1, 0.0025) == pytest.approx(-0.2, rel=1e-9)
    later = knee + 0.03
    wanted = target + 2.0 * q.servo_lag * exp(-0.03 / q.servo_lag)
    servo = Servo(q)
    servo.command(1800, 0.0)
    assert servo.advance(0.0, later) == pytest.approx(wanted, rel=1e-9)


def test_end_stops_and_direction_and_a_missing_pulse() -> None:
    assert after(Servo(NOMINAL), 2200, 1.0, 0.0025) == pytest.approx(-NOMINAL.steering_limit)
    assert after(Servo(NOMINAL), 1000, 1.0, 0.0025) == pytest.approx(0.475)
    servo = Servo(NOMINAL)
    reached = after(servo, 1600, 1.0, 0.0025)
    servo.command(0, 1.0)
    assert servo.advance(1.0, 2.0) == pytest.approx(reached), "no pulse leaves it alone"


def test_commands_within_one_step_are_kept_apart() -> None:
    """A pulse shorter than the delay must come out as a pulse, delayed, even in one long step."""
    q = replace(NOMINAL, servo_lag=0.0, servo_rate_limit=1e6)
    servo = Servo(q)
    servo.command(1600, 0.0)
    servo.advance(0.0, 0.005)
    servo.command(1500, 0.005)
    assert servo.advance(0.005, 0.0175) == pytest.approx(-100 * q.rad_per_us)
    assert servo.advance(0.0175, 0.03) == pytest.approx(0.0)


# ---- The simulated motor: delay and dead zone before the drive.


def test_the_motor_by_its_delay_dead_zone_and_missing_pulses() -> None:
    motor = Motor(replace(NOMINAL, throttle_delay=0.1))
    motor.command(1700, 0.0)
    assert motor.wanted_speed(0.099) == 0.0
    assert motor.wanted_speed(0.101) == pytest.approx(200 * NOMINAL.speed_per_us)
    lost = Motor(replace(NOMINAL, throttle_lost_us=30))
    assert lost.wanted_speed(0.0) == 0.0
    lost.command(1370, 0.0)
    assert lost.wanted_speed(0.0) == pytest.approx(-100 * NOMINAL.speed_per_us)
    lost.command(0, 0.1)
    assert lost.wanted_speed(0.2) == 0.0
