"""An IMU on the wheel: gain, curve, play, lag, rate limit and delay out of a ramp and steps."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from synthetic_servo import rover, seen_by_imu

from rover_sweep.bench.bench_folder import BenchResult
from rover_sweep.bench.by_wheel import Wheel, by_wheel
from rover_sweep.errors import DataRefused

LEVELS = (120.0, 250.0)
PARAMETERS = rover(b=0.012, e=0.05, c3=3.0, w=0.006, lag=0.035, rate=3.0)
TRUTH = {
    "centre": 0.00095,
    "backlash": 0.012,
    "asymmetry": 0.05,
    "nonlinearity": 3.0,
    "deadband": 0.006,
    "servo_lag": 0.035,
    "servo_rate_limit": 3.0,
}


def values(result: BenchResult) -> dict[str, float]:
    return {number.name: number.value for number in result.numbers}


@pytest.mark.parametrize("as_rate", [False, True])
def test_all_that_is_there_is_found(as_rate: bool):
    command, wheel = seen_by_imu(PARAMETERS, LEVELS, np.random.default_rng(3), as_rate)
    result = by_wheel(command, wheel, 1.0)
    found = values(result)
    assert {name: found[name] for name in TRUTH} == pytest.approx(TRUTH, rel=0.06 if as_rate else 0.03)
    delay = result.get("servo_delay")
    assert delay is not None and delay.low <= PARAMETERS.servo_delay <= delay.high
    assert result.get("trim_us") is None and any("trim_us" in text for text in result.untold)


def test_intervals_hold_the_truth():
    rng = np.random.default_rng(8)
    held, draws = dict.fromkeys((*TRUTH, "servo_delay"), 0), 8
    for _ in range(draws):
        result = by_wheel(*seen_by_imu(PARAMETERS, (250.0,), rng), 1.0)
        for name, value in {**TRUTH, "servo_delay": PARAMETERS.servo_delay}.items():
            number = result.get(name)
            assert number is not None
            held[name] += number.low <= value <= number.high
    assert all(count >= 5 for count in held.values()), held  # 90 %: fewer than 5 of 8 once in 200 times
    assert sum(held.values()) >= 0.8 * draws * len(held)


def test_a_clock_of_its_own_leaves_the_delay_untold():
    command, wheel = seen_by_imu(PARAMETERS, LEVELS, np.random.default_rng(4), clock=inf, ahead=1.7e9)
    result = by_wheel(command, wheel, 1.0)
    assert result.get("servo_delay") is None and any("servo_delay" in text for text in result.untold)
    found = values(result)
    assert {name: found[name] for name in TRUTH} == pytest.approx(TRUTH, rel=0.05)


def test_an_imu_upside_down_is_turned_by_the_sign_in_the_vehicle_file():
    command, wheel = seen_by_imu(PARAMETERS, LEVELS, np.random.default_rng(5))
    result = by_wheel(command, Wheel(wheel.t, -wheel.value, False, 0.0), 1.0)
    assert values(result)["asymmetry"] == pytest.approx(0.05, abs=0.005)
    assert any("positive to the right" in text for text in result.remarks)


def test_a_rate_limit_that_no_step_reaches_is_not_told():
    command, wheel = seen_by_imu(rover(b=0.01, lag=0.04, rate=50.0), (60.0,), np.random.default_rng(6))
    limit = by_wheel(command, wheel, 1.0).get("servo_rate_limit")
    assert limit is not None and not limit.determined and limit.low > 1.0


def test_a_wheel_that_does_not_follow_is_refused():
    command, wheel = seen_by_imu(PARAMETERS, LEVELS, np.random.default_rng(7))
    noise = np.cumsum(np.random.default_rng(0).standard_normal(wheel.t.size)) * 1e-3
    with pytest.raises(DataRefused, match="does not follow"):
        by_wheel(command, Wheel(wheel.t, noise, False, 0.0), 1.0)
