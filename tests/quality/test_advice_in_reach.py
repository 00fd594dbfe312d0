"""The amplitude that is advised is in the unit of the recording, and within what the steering can do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from damage import damaged

from rover_sweep.data.recording import Recording
from rover_sweep.live.verdict import proposed
from rover_sweep.quality.coherence import WHEEL_LOCK, assess, responses

ENDS = {"SERVO1_FUNCTION": 26.0, "SERVO1_MIN": 1300.0, "SERVO1_MAX": 1750.0, "SERVO1_TRIM": 1500.0}


def noisy(run: Recording, sd: float) -> Recording:
    noise = np.random.default_rng(1)
    return damaged(run, ay=lambda x: x + sd * noise.standard_normal(x.size))


def with_angle_alone(run: Recording, rad_per_us: float) -> Recording:
    pwm = run["pwm"]
    delta = replace(pwm, x=-(pwm.x - 1500) * rad_per_us, unit="rad")
    return replace(run.without({"pwm"}), channels={**run.without({"pwm"}).channels, "delta": delta})


@pytest.mark.parametrize("rad_per_us", [0.00095, 0.003])
def test_an_angle_is_advised_in_rad_and_within_the_lock(sweep: Recording, rad_per_us: float) -> None:
    run = with_angle_alone(noisy(sweep, 60.0), rad_per_us)
    found = proposed(run, responses([run]), {})
    assert " us" not in found.sentence and " rad" in found.sentence
    assert all(band.amplitude <= WHEEL_LOCK for band in found.bands)
    assert found.amplitude is None or found.amplitude <= WHEEL_LOCK
    assert "but the steering reaches only 0.6 rad" in assess(run).sentence
    assert "times the amplitude" not in assess(run).sentence


def test_a_large_angle_is_no_pulse(sweep: Recording) -> None:
    """What was driven is in reach, however large, and stays an angle."""
    run = with_angle_alone(sweep, 0.0097)
    found = proposed(run, responses([run]), {})
    assert run["delta"].x.max() > 1.1 and " us" not in found.sentence


def test_no_advice_goes_beyond_the_stops(sweep: Recording) -> None:
    run = replace(noisy(sweep, 60.0), vehicle={k: f"{x:g}" for k, x in ENDS.items()})
    found = proposed(run, responses([run], input="pwm"), ENDS)
    assert all(band.amplitude <= 200.0 for band in found.bands)
    assert "the steering reaches only 200 us" in assess(run).sentence
    low = proposed(run, responses([run], input="pwm"), {**ENDS, "SWP_PWM_MAX": 170.0})
    assert all(band.amplitude <= 170.0 for band in low.bands)


def test_without_recorded_stops_a_usual_servo_is_assumed(sweep: Recording) -> None:
    run = replace(noisy(sweep, 60.0), vehicle={})
    bands = proposed(run, responses([run], input="pwm"), {}).bands
    assert max(band.amplitude for band in bands) <= 500.0
