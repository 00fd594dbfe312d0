"""The simulated motor: delay and dead zone before the drive."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sitl.plant.motor import Motor
from sitl.plant.plant import Plant
from sitl.plant.variant import load_variant

NOMINAL = load_variant("nominal")


def steady_speed(us: float, **changes: float) -> float:
    plant = Plant(replace(NOMINAL, road_force=0.0, road_yaw_moment=0.0, road_roll_moment=0.0, **changes))
    for _ in range(4000):
        plant.step(1500, us, 0.0025)
    return plant.state.vx


def test_delay_holds_a_change_back() -> None:
    motor = Motor(replace(NOMINAL, throttle_delay=0.1))
    motor.command(1700, 0.0)
    assert motor.wanted_speed(0.099) == 0.0
    assert motor.wanted_speed(0.101) == pytest.approx(200 * NOMINAL.speed_per_us)


def test_lost_throttle_shifts_the_drive() -> None:
    plain, lost = steady_speed(1700), steady_speed(1730, throttle_lost_us=30)
    assert lost == pytest.approx(plain, rel=1e-3) and plain > 2.0
    assert Motor(replace(NOMINAL, throttle_lost_us=30)).wanted_speed(0.0) == 0.0


def test_both_sides_of_neutral() -> None:
    motor = Motor(replace(NOMINAL, throttle_lost_us=30))
    motor.command(1370, 0.0)
    assert motor.wanted_speed(0.0) == pytest.approx(-100 * NOMINAL.speed_per_us)


def test_no_pulse_is_no_drive() -> None:
    motor = Motor(NOMINAL)
    motor.command(1700, 0.0)
    motor.command(0, 0.1)
    assert motor.wanted_speed(0.2) == 0.0
