"""Angles read by hand: what comes out, and that the intervals hold what is true."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_servo import read_by_hand, rover, slope_by_hand

from rover_sweep.bench.evaluate import Readings, by_hand
from rover_sweep.errors import DataRefused

DRAWS = 200
LEVELS = (50.0, 100.0, 200.0, 300.0)


@pytest.mark.parametrize("w", [0.0, 0.012])
def test_intervals_hold_the_truth(w: float):
    parameters = rover(b=0.012, e=0.06, c3=2.0, w=w, trim=1508.0)
    rng = np.random.default_rng(11)
    truth = {
        "rad_per_us": slope_by_hand(parameters, 292.0),
        "trim_us": 1508.0,
        "backlash": 0.012,
        "asymmetry": 0.06,
        "nonlinearity": 2.0,
        "deadband": w,
    }
    held = dict.fromkeys(truth, 0)
    for _ in range(DRAWS):
        result = by_hand(read_by_hand(parameters, LEVELS, rng), 1500.0)
        for name, value in truth.items():
            number = result.get(name)
            assert number is not None
            held[name] += number.low <= value <= number.high
    shares = {name: count / DRAWS for name, count in held.items()}
    # 90 % intervals; at a true 0 a size that cannot be negative is held more often
    assert all(0.82 <= share <= (0.98 if truth[name] == 0 else 0.96) for name, share in shares.items()), (
        shares
    )


def test_exact_angles_give_the_exact_numbers():
    parameters = rover(b=0.02, e=-0.08, c3=3.0, w=0.01, trim=1490.0)
    exact = read_by_hand(parameters, LEVELS, np.random.default_rng(0))
    noise = np.radians(0.5) * np.random.default_rng(0).standard_normal(exact.pwm.size)
    result = by_hand(Readings(exact.pwm, exact.angle - noise, 1500.0), 1500.0)
    for name, value in (
        ("trim_us", 1490),
        ("backlash", 0.02),
        ("asymmetry", -0.08),
        ("deadband", 0.01),
        ("nonlinearity", 3.0),
        ("centre", 0.00095),
    ):
        number = result.get(name)
        assert number is not None and number.value == pytest.approx(value, rel=0.02)


def test_a_servo_that_turns_left_with_a_larger_pwm():
    readings = read_by_hand(rover(b=0.01), LEVELS, np.random.default_rng(1))
    slope = by_hand(Readings(readings.pwm, -readings.angle, 1500.0), 1500.0).get("rad_per_us")
    assert slope is not None and slope.value == pytest.approx(-0.00095, rel=0.05)


def test_two_levels_tell_no_curve_and_say_so():
    result = by_hand(read_by_hand(rover(b=0.01), (80.0, 160.0), np.random.default_rng(2)), 1500.0)
    assert result.get("nonlinearity") is None and result.get("deadband") is None
    assert any("--steps" in text for text in result.untold)
    assert result.get("servo_lag") is None and any("servo_lag" in text for text in result.untold)


def test_angles_left_out_are_done_without():
    readings = read_by_hand(rover(b=0.012), LEVELS, np.random.default_rng(3))
    angle = readings.angle.copy()
    angle[1::4] = np.nan
    number = by_hand(Readings(readings.pwm, angle, 1500.0), 1500.0).get("rad_per_us")
    assert number is not None and number.value == pytest.approx(0.00095, rel=0.05)


def test_too_few_angles_are_refused():
    readings = read_by_hand(rover(), LEVELS, np.random.default_rng(4))
    with pytest.raises(DataRefused, match="4 angles were read"):
        by_hand(Readings(readings.pwm[:4], readings.angle[:4], 1500.0), 1500.0)
