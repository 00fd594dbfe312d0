"""Steering servo: delay, lag, rate limit, end stops, on any step."""

from __future__ import annotations

from dataclasses import replace
from math import exp

import pytest

from sitl.plant.servo import Servo
from sitl.plant.variant import load_variant

NOMINAL = load_variant("nominal")


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


def test_end_stops_and_direction() -> None:
    assert after(Servo(NOMINAL), 2200, 1.0, 0.0025) == pytest.approx(-NOMINAL.steering_limit)
    assert after(Servo(NOMINAL), 1000, 1.0, 0.0025) == pytest.approx(0.475)


def test_a_missing_pulse_leaves_it_alone() -> None:
    servo = Servo(NOMINAL)
    reached = after(servo, 1600, 1.0, 0.0025)
    servo.command(0, 1.0)
    assert servo.advance(1.0, 2.0) == pytest.approx(reached)


def test_commands_within_one_step_are_kept_apart() -> None:
    """A pulse shorter than the delay must come out as a pulse, delayed, even in one long step."""
    q = replace(NOMINAL, servo_lag=0.0, servo_rate_limit=1e6)
    servo = Servo(q)
    servo.command(1600, 0.0)
    servo.advance(0.0, 0.005)
    servo.command(1500, 0.005)
    assert servo.advance(0.005, 0.0175) == pytest.approx(-100 * q.rad_per_us)
    assert servo.advance(0.0175, 0.03) == pytest.approx(0.0)
