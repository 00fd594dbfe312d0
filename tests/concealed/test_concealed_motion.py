"""The simulated rover against textbook formulas, and every concealed effect in it and out of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.concealed import motion
from tests.concealed.drive import Drive, draw_plan, steer
from tests.concealed.effects import UNKNOWN, Effect, draw_effect, ids
from tests.concealed.rover import GRAVITY, Nuisance, Rover
from tests.concealed.run import Array, _rover_numbers, move, road_wheel
from tests.concealed.sensors import measure, turned
from tests.concealed.sets import Case, draw_case, stream
from tests.concealed.sizing import QUIET, outputs

CASE = draw_case(11, 1, "none")
ROVER, OFF = CASE.rover, CASE.off
# Values at which an effect is not there: 0, infinite, or what the rover has anyway.
ABSENT = {
    "servo_lag": {"T": OFF.servo_lag},
    "servo_rate_limit": {"R": 1e9},
    "steering_deadband": {"w": 0.0},
    "steering_backlash": {"b": 0.0},
    "steering_nonlinearity": {"c3": 0.0},
    "steering_asymmetry": {"e": 0.0},
    "steering_trim": {"u0": OFF.trim},
    "transport_delay": {"T": OFF.delay},
    "clock_offset": {"T": 0.0},
    "tyre_relaxation": {"sigma": 0.0},
    "load_transfer": {"k": 0.0},
    "front_rear_stiffness": {"ratio": ROVER.cf / ROVER.cr},
    "roll_steer": {"e": 0.0},
    "suspension_friction": {"T": 0.0},
    "speed_variation": {"D": 0.0},
    "imu_offset": {"x": 0.0, "z": 0.0},
    "imu_tilt": {"roll": 0.0, "pitch": 0.0, "yaw": 0.0},
    "velocity_lag": {"T": 0.0},
    "sensor_filter": {"gyro_hz": np.inf, "accel_hz": np.inf},
    "cross_slope": {"b": 0.0, "psi0": 1.0},
    "locked_differential": {"scrub": 0.0},
    "flexing_chassis": {"flex": 0.0},
    "side_wind": {"wind": 0.0},
}


def circle(rover: Rover, delta: float, speed: float) -> np.ndarray:
    """Last state and rates of a long constant turn."""
    n = 12_000
    q = motion.vector({**_rover_numbers(rover), "motor_lag": 0.01})  # holds the speed
    x = motion.drive(q, np.full(n, delta), np.full(n, speed), np.zeros((n, 4)), 0.0)
    return np.asarray(x[-1])


def test_steady_turn_is_that_of_the_textbook() -> None:
    delta, speed = 0.01, 2.0
    x, base = circle(ROVER, delta, speed), ROVER.a + ROVER.b
    understeer = ROVER.m * (ROVER.b * ROVER.cr - ROVER.a * ROVER.cf) / (base**2 * ROVER.cf * ROVER.cr)
    r = speed * delta / (base * (1 + understeer * speed**2))
    ay = speed * r
    assert x[1] == pytest.approx(r, rel=1e-3)
    assert x[2] == pytest.approx(
        ROVER.ms * ROVER.h * ay / (ROVER.k_phi - ROVER.ms * GRAVITY * ROVER.h), rel=1e-3
    )
    side_slip = ROVER.b / base - ROVER.a * ROVER.m * speed**2 / (base**2 * ROVER.cr)
    assert x[0] / speed == pytest.approx(delta * side_slip / (1 + understeer * speed**2), rel=5e-3, abs=1e-6)


def test_roll_swings_at_its_frequency() -> None:
    """On ice the whole rover gives way under the roll, so the frequency is that of the coupled pair."""
    n, q = 3000, motion.vector({**_rover_numbers(ROVER), "b_phi": 0.0, "cf": 1e-6, "cr": 1e-6})
    push = np.zeros((n, 4))
    push[:50, 2] = 0.05
    phi = motion.drive(q, np.zeros(n), np.full(n, 1.0), push, 0.0)[:, 2]
    crossings = np.flatnonzero(np.diff(np.signbit(phi[60:] - phi[60:].mean()))) * motion.STEP
    msh = ROVER.ms * ROVER.h
    about = ROVER.ixx + msh * ROVER.h - msh**2 / ROVER.m
    expected = np.sqrt((ROVER.k_phi - msh * GRAVITY) / about)
    assert np.pi / np.mean(np.diff(crossings)) == pytest.approx(expected, rel=0.01)


def test_the_tyre_coincides_with_a_linear_one_below_the_noise() -> None:
    """At the largest amplitude of plans drawn anew, the law's curvature is within 5 % of the noise, rms."""
    for number in (1, 2):
        case = draw_case(21, number, "none")
        case = replace(case, plan=case.plan[1:2])  # the run of the largest amplitude
        linear = replace(case, rover=replace(case.rover, friction=1e6))
        own, straight, noisy = outputs(case)[0], outputs(linear)[0], outputs(case, 1)[0]
        curved, noise = (own - straight).std(axis=1), (noisy - own).std(axis=1)
        assert np.all(curved < 0.05 * noise), curved / noise


def test_concealed_saturation_is_tanh_to_third_order() -> None:
    slip = np.linspace(0.0, 0.25, 50)
    here = np.array([motion.tyre(30.0, s, 12.0, 1.1, 0.8) for s in slip])
    tanh = 0.8 * 12.0 * np.tanh(30.0 * slip / (0.8 * 12.0))
    assert np.max(np.abs(here - tanh)) < 0.02 * tanh.max()
    assert np.max(np.abs(here - 30.0 * slip)) > 0.1 * tanh.max()


def seen(hidden: tuple[Effect, ...], drive: Drive) -> np.ndarray:
    """All that the effect could show itself in, without noise: gyro, accelerometer, velocity, attitude."""
    rng = stream(0, 0, 0)
    moved = move(ROVER, OFF, drive, steer(drive, stream(0, 0, 1)), hidden, QUIET, rng)
    m = measure(moved, ROVER, OFF, hidden, QUIET, (20.0, 20.0), rng)
    return np.column_stack([m.gyro, m.accel, m.velocity, m.phi, m.psi])


DOUBLETS = CASE.plan[3]
PLAIN = seen((), DOUBLETS)
ELSEWHERE = {
    "clock_offset",
    "imu_offset",
    "tyre_slip",
    "roll_dof",
}  # in the stamps, the file, the baseline asked for


@pytest.mark.parametrize("effect", [name for name in (*ids(), *UNKNOWN) if name not in ELSEWHERE])
def test_an_effect_shows_and_vanishes_at_its_absent_value(effect: str) -> None:
    drawn = draw_effect(effect, 2.0, ROVER, stream(1, 1, 1))
    if effect == "surface_change":
        drawn = replace(drawn, run=DOUBLETS.name, detail={"fraction": 0.01})
        gone = replace(drawn, parameters={"ratio": 1.0, "t": 0.0})
    elif effect == "tyre_saturation":  # its absence is the rover's own tyre, see the test of the law
        gone = None
    else:
        gone = replace(drawn, parameters=ABSENT[effect])
    shown = np.abs(seen((drawn,), DOUBLETS) - PLAIN).max(axis=0)
    assert shown.max() > 1e-2
    assert gone is None or np.array_equal(seen((gone,), DOUBLETS), PLAIN)


def test_servo_linkage_and_delay_keep_their_conventions() -> None:
    """Slow steering shows each static law of the linkage, a step the whole lag and the whole delay."""
    drive = CASE.plan[1]
    steering = steer(drive, stream(2, 2, 2))
    t: Array = np.arange(int(drive.length / motion.STEP), dtype=np.float64) * motion.STEP
    off: Nuisance = replace(OFF, trim=0.0)

    def angle(effect: str, **parameters: float) -> np.ndarray:
        return road_wheel(ROVER, off, t, steering, (Effect(effect, parameters, {}),))

    u = road_wheel(ROVER, off, t, steering, ())
    slow = t < drive.start + drive.straight + 12.0
    left, right = slow & (u > 0.02), slow & (u < -0.02)
    assert np.allclose((angle("steering_asymmetry", e=0.1) / np.where(u == 0, 1, u))[left], 1.1)
    assert np.allclose((angle("steering_asymmetry", e=0.1) / np.where(u == 0, 1, u))[right], 0.9)
    assert np.allclose(angle("steering_nonlinearity", c3=2.0), u + 2 * u**3)
    assert np.allclose((u - angle("steering_deadband", w=0.01))[left], 0.01)
    assert np.allclose(angle("steering_trim", u0=0.02), u - 0.02)
    gap = u - angle("steering_backlash", b=0.01)
    assert np.abs(gap).max() == pytest.approx(0.01) and gap[left].min() < 0 < gap[left].max()
    assert np.abs(np.diff(angle("servo_rate_limit", R=0.5))).max() <= 0.5 * motion.STEP * (1 + 1e-9)
    for effect, whole in (("servo_lag", OFF.servo_lag), ("transport_delay", OFF.delay)):
        later = angle(effect, T=whole + 0.05)
        area = np.sum((u - later)[: int((drive.start + drive.straight + 1.5) / motion.STEP)]) * motion.STEP
        end = u[int((drive.start + drive.straight + 1.5) / motion.STEP)]
        assert area / end == pytest.approx(0.05, abs=0.005)  # behind a rising angle the area is rise x lag


def test_imu_tilt_and_slope_keep_their_signs() -> None:
    still = DOUBLETS
    parked = int(0.5 / motion.STEP)
    roll = seen((Effect("imu_tilt", {"roll": 0.05}, {}),), still)[parked] - PLAIN[parked]
    assert roll[4] == pytest.approx(GRAVITY * np.sin(0.05), rel=1e-3)
    bank = (
        seen((Effect("cross_slope", {"b": 0.03, "psi0": still.heading}, {}),), still)[parked] - PLAIN[parked]
    )
    assert bank[4] > 0.95 * GRAVITY * 0.03  # and the body leans downhill on its springs
    assert np.allclose(turned(0.1, 0.2, 0.3) @ turned(0.1, 0.2, 0.3).T, np.eye(3))


def test_plans_are_gentle_and_rovers_sensible() -> None:
    for number in range(1, 30):
        case: Case = draw_case(31, number, "none")
        assert 0.25 < case.rover.a + case.rover.b < 0.55 and 0.8 < case.rover.m < 8
        assert case.off.servo_lag + case.off.delay <= 0.07
        assert case.rover.critical_speed() > 1.5 * max(drive.speed for drive in case.plan)
        assert case.plan[1].amplitude_us == 2 * case.plan[0].amplitude_us
        assert case.plan[1].amplitude_us * case.rover.rad_per_us < 0.27
        assert len({round(drive.heading % (2 * np.pi), 1) for drive in case.plan}) == 4
    assert draw_plan(stream(1, 1, 1), ROVER) == draw_plan(stream(1, 1, 1), ROVER)
