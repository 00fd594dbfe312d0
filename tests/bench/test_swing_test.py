"""The swing test: against a simulated pendulum, Monte Carlo, and what it says of bad tests."""

from __future__ import annotations

import math
import random
import statistics
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rover_sweep.bench.swing_test import (
    GRAVITY,
    Swings,
    SwingTest,
    gravity_check,
    moment_of_inertia,
    remarks,
    rounded,
)
from rover_sweep.data.vehicle_file import Measured

TEST = SwingTest(
    mass=Measured(2.66, 0.005),
    length=Measured(1.2, 0.003),
    spacing=Measured(0.3, 0.001),
    period=Measured(2.373, 0.006),
    rig_mass=Measured(0.4, 0.002),
    rig_period=Measured(1.5, 0.006),
)


def bifilar_period(inertia: float, mass: float, length: float, spacing: float, start: float) -> float:
    """Period of a body on two wires from its energy: it rises by h - sqrt(h^2 - d^2 sin^2(theta/2))."""
    g = GRAVITY.value

    def motion(_: float, state: list[float]) -> list[float]:
        theta, rate = state
        height = math.sqrt(length**2 - (spacing * math.sin(theta / 2)) ** 2)
        return [rate, -mass * g * spacing**2 * math.sin(theta) / (4 * height) / inertia]

    def stop(_: float, state: list[float]) -> float:
        return state[1]

    stop.terminal, stop.direction = True, 1.0  # type: ignore[attr-defined]
    solved = solve_ivp(motion, (0, 10), [start, -1e-9], events=stop, rtol=1e-10, atol=1e-12)
    return 2 * float(solved.t_events[0][0])


def test_equation_2_recovers_the_inertia_of_a_simulated_bifilar_pendulum() -> None:
    period = bifilar_period(0.071, 2.66, 1.2, 0.3, math.radians(3))
    test = SwingTest(Measured(2.66), Measured(1.2), Measured(0.3), Measured(period))
    assert moment_of_inertia(test).moment.value == pytest.approx(0.071, rel=5e-4)


def test_large_angles_cost_what_the_caveat_says() -> None:
    small, large = (bifilar_period(0.071, 2.66, 1.2, 0.3, math.radians(x)) for x in (0.5, 20))
    assert 100 * (large / small - 1) == pytest.approx(0.8, abs=0.1)


def test_equation_1() -> None:
    period = 2 * math.pi * math.sqrt(1.2 / GRAVITY.value)
    check = gravity_check(Measured(1.2, 0.003), Measured(period, 0.005))
    assert check.passed and check.percent == pytest.approx(0, abs=1e-9)
    assert not gravity_check(Measured(1.2, 0.1), Measured(period * 1.03, 0.1)).passed  # 6 % off, not in sd
    assert not gravity_check(Measured(1.2, 1e-4), Measured(period * 1.005, 1e-4)).passed  # 1 % off, many sd


def test_rig_is_taken_off() -> None:
    alone = replace(TEST, rig_mass=None, rig_period=None)
    rig = SwingTest(Measured(0.4), Measured(1.2), Measured(0.3), Measured(1.5))
    heavier = replace(alone, mass=Measured(3.06))
    together = moment_of_inertia(TEST).moment.value
    taken_off = moment_of_inertia(heavier).moment.value - moment_of_inertia(rig).moment.value
    assert together == pytest.approx(taken_off, rel=1e-12)
    assert together != pytest.approx(moment_of_inertia(alone).moment.value, rel=1e-3)


@pytest.mark.parametrize("with_rig", [True, False])
def test_first_order_sd_agrees_with_monte_carlo(with_rig: bool) -> None:
    test = TEST if with_rig else replace(TEST, rig_mass=None, rig_period=None)
    rng = np.random.default_rng(3)

    def drawn(x: Measured, size: int = 100_000) -> np.ndarray:
        return rng.normal(x.value, x.sd or 0.0, size)

    g, m, d, h, t = (drawn(x) for x in (GRAVITY, test.mass, test.spacing, test.length, test.period))
    moment = m * g * d**2 * t**2 / (16 * np.pi**2 * h)
    if test.rig_mass and test.rig_period:
        mr, tr = drawn(test.rig_mass), drawn(test.rig_period)
        moment = moment + mr * g * d**2 * (t**2 - tr**2) / (16 * np.pi**2 * h)
    result = moment_of_inertia(test)
    assert result.moment.value == pytest.approx(float(moment.mean()), rel=1e-3)
    assert result.moment.sd == pytest.approx(float(moment.std()), rel=0.01)
    assert sum(result.shares.values()) == pytest.approx(1)
    assert ("rig period" in result.shares) == with_rig


def test_period_from_several_times() -> None:
    period = Swings((47.5, 47.3, 47.6), 20, timer_sd=0.01).period
    assert period.value == pytest.approx(47.4667 / 20, rel=1e-5)
    assert period.sd == pytest.approx(statistics.stdev((47.5, 47.3, 47.6)) / math.sqrt(3) / 20)
    assert Swings((2.4,), 1).period == Measured(2.4, 0.2)  # one time: the timer's own uncertainty
    with pytest.raises(ValueError, match="times > 0"):
        Swings(())


def test_sd_of_repeated_timings_is_honest() -> None:
    """Over many made-up experiments the true period lies within 2 sd about 95 % of the time."""
    rng = random.Random(5)
    hits = 0
    for _ in range(500):
        period = Swings(tuple(47.0 + rng.gauss(0, 0.2) for _ in range(5)), 20, timer_sd=0.2).period
        hits += abs(period.value - 2.35) < 2 * (period.sd or 0)
    assert 465 <= hits <= 500


def test_remarks_name_what_is_wrong() -> None:
    test = replace(TEST, mass=Measured(2.66))
    bad = gravity_check(Measured(1.2, 0.003), Measured(2.0, 0.002))
    said = " ".join(remarks(test, moment_of_inertia(test), bad, Measured(2.0)))
    assert "off 9.81 m/s^2" in said and "exact" in said and "mass" in said
    said = " ".join(remarks(test, moment_of_inertia(test), None, None))
    assert "--check-times" in said and "one motion excites" not in said
    assert "excites the other" in " ".join(remarks(test, moment_of_inertia(test), None, Measured(2.4)))


def test_rounded_to_the_second_digit_of_the_sd() -> None:
    assert rounded(Measured(0.0698123, 0.000634)) == Measured(0.06981, 0.00063)
    assert rounded(Measured(0.0698123)) == Measured(0.0698123)
