"""The amplitude that is advised is in the unit of the recording, and within what the steering can do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from damage import damaged

from rover_sweep.data.recording import Recording
from rover_sweep.quality.verdict import WHEEL_LOCK, assess

ENDS = {"SERVO1_MIN": 1300.0, "SERVO1_MAX": 1750.0, "SERVO1_TRIM": 1500.0}


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
    found = assess(run).next
    assert " us" not in found.sentence and " rad" in found.sentence
    assert all(band.amplitude <= WHEEL_LOCK for band in found.bands)
    assert found.amplitude is None or found.amplitude <= WHEEL_LOCK
    assert " allows " in assess(run).sentence and " us" not in assess(run).sentence


def test_a_large_angle_is_no_pulse(sweep: Recording) -> None:
    """What was driven is in reach, however large, and stays an angle."""
    run = with_angle_alone(sweep, 0.0097)
    found = assess(run).next
    assert run["delta"].x.max() > 1.1 and " us" not in found.sentence


def test_no_advice_goes_beyond_the_stops(sweep: Recording) -> None:
    run = replace(noisy(sweep, 60.0), limits=ENDS)
    assert all(band.amplitude <= 200.0 for band in assess(run).next.bands)
    assert "the end stop (SERVO1_MIN and _MAX) allows 200 us" in assess(run).sentence
    low = assess(replace(run, limits={**ENDS, "SWP_PWM_MAX": 170.0})).next
    assert all(band.amplitude <= 170.0 for band in low.bands)


def test_without_recorded_stops_a_usual_servo_is_assumed(sweep: Recording) -> None:
    bands = assess(replace(noisy(sweep, 60.0), limits={})).next.bands
    assert max(band.amplitude for band in bands) <= 500.0
