"""The firmware's controller in time and frequency, and what stands between it and the wheels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from acro_drive import limited_targets

from rover_sweep.data.geometry import Geometry
from rover_sweep.gains.controller import RatePid, feedback_response
from rover_sweep.gains.steering_chain import Gains, autopilot, sampled_plant
from rover_sweep.gains.tuning import frequencies, margins
from rover_sweep.identification.models import bicycle

CAR = Geometry(mass=2.66, a=0.203, b=0.188, yaw_inertia=0.07)
MODEL = bicycle(CAR).with_values({"C": 32.0, "Izz": 0.07, "tau": 0.033})
NONE = np.zeros(1, dtype=bool)


def test_one_tick_at_a_time_by_hand():
    """Two ticks of AC_PID::update_all worked out on paper: 10 Hz error filter at 50 Hz, P, I and D."""
    gains = Gains(ff=0.5, p=2.0, i=3.0, d=0.1, flte=10.0)
    pid = RatePid(gains, 0.02, np.array([2.0]), np.array([3.0]), np.array([0.5]))
    first = pid.update(1.0, np.array([0.2]), NONE)[0]
    assert first == pytest.approx(2.0 * 0.8 + 3.0 * 0.8 * 0.02 + 0.5)
    share = 0.02 / (0.02 + 1 / (2 * math.pi * 10))
    error = 0.8 + share * (0.6 - 0.8)
    second = pid.update(1.0, np.array([0.4]), NONE)[0]
    held = 3.0 * 0.8 * 0.02 + 3.0 * error * 0.02
    assert second == pytest.approx(2.0 * error + held + 0.1 * (error - 0.8) / 0.02 + 0.5)


def test_a_limited_integrator_only_shrinks_and_ends_at_its_limit():
    gains = Gains(ff=0.0, p=0.0, i=1.0, imax=0.05, flte=0.0)
    pid = RatePid(gains, 0.1, np.zeros(1), np.ones(1), np.zeros(1))
    limited = np.ones(1, dtype=bool)
    assert pid.update(1.0, np.zeros(1), limited)[0] == 0.0
    assert pid.update(1.0, np.zeros(1), NONE)[0] == pytest.approx(0.05)  # not 0.1
    assert pid.update(1.0, np.zeros(1), limited)[0] == pytest.approx(0.05)
    assert pid.update(-0.3, np.zeros(1), limited)[0] == pytest.approx(0.02)


@pytest.mark.parametrize("filters", [{}, {"flte": 3.0}, {"flte": 0.0, "d": 0.05, "fltd": 5.0}])
def test_the_frequency_response_is_that_of_the_ticks(filters: dict[str, float]):
    """A sine through the controller in time against its response, computed apart."""
    gains, dt = Gains(ff=0.0, p=0.7, i=1.1, **filters), 0.02
    w = 2 * math.pi * 40 / (1000 * dt)  # 40 periods in 1000 ticks
    pid = RatePid(gains, dt, np.array([gains.p]), np.array([gains.i]), np.zeros(1))
    k = np.arange(4000)
    errors = np.cos(w * dt * k)
    out = np.array([pid.update(float(e), np.zeros(1), NONE)[0] for e in errors])[3000:]
    seen = 2 * np.mean((out - out.mean()) * np.exp(-1j * w * dt * k[3000:]))
    told = feedback_response(gains, np.array([0.7]), np.array([1.1]), dt, np.array([w]))[0, 0]
    assert seen == pytest.approx(told, rel=1e-3)


def test_margins_of_a_loop_known_on_paper():
    """exp(-sT) K/s: crossover K, phase margin 90 deg - K T, gain margin pi / (2 K T)."""
    w, gain, late = frequencies(0.001), 4.0, 0.1
    found = margins(gain / (1j * w) * np.exp(-1j * w * late), w)
    assert found.crossover == pytest.approx(gain, rel=1e-3)
    assert found.phase_deg == pytest.approx(90 - math.degrees(gain * late), abs=0.1)
    assert found.gain_db == pytest.approx(20 * math.log10(math.pi / (2 * gain * late)), abs=0.05)
    assert found.phase_crossover == pytest.approx(math.pi / (2 * late), rel=1e-2)
    unstable = margins(30.0 / (1j * w) * np.exp(-1j * w * late), w)
    assert unstable.gain_db < 0 and unstable.phase_deg < 0


def test_the_sampled_plant_is_the_continuous_one_held():
    """Below a tenth of the loop rate: model, gyro low-pass and the hold's half period."""
    loop = autopilot({"SCHED_LOOP_RATE": 100.0, "INS_GYRO_FILTER": 20.0})
    plant = sampled_plant(MODEL, 2.5, loop)
    w = np.array([0.5, 3.0, 10.0, 25.0])
    w0 = 2 * math.pi * 20
    gyro = w0**2 / ((1j * w) ** 2 + math.sqrt(2) * w0 * 1j * w + w0**2)
    held = (1 - np.exp(-0.01j * w)) / (0.01j * w)
    assert plant.response(w) == pytest.approx(MODEL.response(w, 2.5, "r") * gyro * held, rel=2e-3)
    assert plant.stable


def test_steering_is_scaled_by_speed_above_the_base_alone():
    loop = autopilot({"MOT_SPD_SCA_BASE": 1.0})
    assert [loop.speed_scale(v) for v in (0.5, 1.0, 2.0, 4.0, -2.0)] == [1.0, 1.0, 0.5, 0.25, 0.5]
    assert [loop.integrates(v) for v in (0.5, 1.0, 2.0)] == [False, False, True]
    off = autopilot({"MOT_SPD_SCA_BASE": 0.0})
    assert off.speed_scale(5.0) == 1.0
    assert not off.integrates(5.0)  # AP_MotorsUGV::output_regular takes the branch that sets the limits


def test_the_target_is_limited_as_in_the_firmware():
    """ATC_STR_ACC_MAX, ATC_STR_RAT_MAX and ATC_TURN_MAX_G over the speed, whichever is less."""
    loop = autopilot({"ATC_STR_ACC_MAX": 120.0, "ATC_STR_RAT_MAX": 90.0, "ATC_TURN_MAX_G": 0.2})
    target = limited_targets(loop, 2.0, np.full(100, 3.0))
    assert target[0] == pytest.approx(math.radians(120) * 0.02)
    assert np.diff(target).max() <= math.radians(120) * 0.02 + 1e-12
    assert target[-1] == pytest.approx(0.2 * 9.80665 / 2.0)
    assert limited_targets(loop, 0.5, np.full(100, 3.0))[-1] == pytest.approx(math.radians(90))


def test_a_reversed_servo_turns_sign_and_sides():
    forward = autopilot({"SERVO1_MIN": 1200, "SERVO1_TRIM": 1500, "SERVO1_MAX": 1900, "SERVO1_REVERSED": 0})
    back = autopilot({"SERVO1_MIN": 1200, "SERVO1_TRIM": 1500, "SERVO1_MAX": 1900, "SERVO1_REVERSED": 1})
    assert (forward.us_right, forward.us_left) == (400, 300)
    assert (back.us_right, back.us_left) == (300, 400)
    assert back.angle_per_output(-0.001) == forward.angle_per_output(0.001) == pytest.approx(0.35)


def test_the_steering_output_is_found_and_what_is_missing_is_named():
    loop = autopilot({"SERVO4_FUNCTION": 26, "SERVO4_MAX": 1800, "ATC_STR_RAT_FF": 0.75})
    assert (loop.servo, loop.us_right) == (4, 300)
    assert loop.gains.ff == 0.75
    assert "SERVO4_MIN" in loop.assumed
    assert "ATC_STR_RAT_FF" not in loop.assumed
    with pytest.raises(ValueError, match="SERVO1_MIN 1600"):
        autopilot({"SERVO1_MIN": 1600.0})
