"""The proposed speed loop: margins by a second formula, limits of the firmware, refusals in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.gains.gains_json import speed_text
from rover_sweep.gains.speed_chain import (
    IdentifiedSpeed,
    SpeedLoop,
    SpeedPlant,
    SpeedSettings,
    accel_limit,
    accelerated,
    cruise,
    margins_of,
    simulate_speed,
    speed_loop,
    step_of_speed,
)
from rover_sweep.gains.speed_proposal import propose_speed

PLANT = SpeedPlant(5.0, 0.7, 0.12, 0.09, 0.06)
FOUND = IdentifiedSpeed(
    PLANT,
    {"gain": (4.8, 5.2), "lag": (0.66, 0.74), "delay": (0.1, 0.14), "offset": (0.08, 0.1)},
    "good",
    (),
    (1.5, 2.3, 3.1),
    (0.2, 8.0),
    0.03,
    (1.7, 0.8),
    {},
    0.05,
)
LOOP = speed_loop({"SCHED_LOOP_RATE": 100.0})


def loop_with(**parameters: float) -> SpeedLoop:
    return speed_loop({"SCHED_LOOP_RATE": 100.0, **parameters})


def constant(speed: float, loop: SpeedLoop = LOOP, seconds: float = 20.0) -> np.ndarray:
    return np.full(round(seconds / loop.period), speed)


def test_proposal_keeps_its_promises() -> None:
    proposal = propose_speed(FOUND, LOOP)
    assert proposal.level == "gains" and proposal.proposed is not None and proposal.now is not None
    best = proposal.proposed
    assert best.worst_gain >= 6 and best.worst_phase >= 45
    assert best.step.overshoot < 0.5 * proposal.now.step.overshoot
    assert best.step.error < 0.75 * proposal.now.step.error
    assert best.settings.p / best.settings.i <= 4.01 * PLANT.lag, "a slope must not take minutes"
    assert best.settings.p * FOUND.residual <= 0.05


def test_uncertain_dead_zone_is_left_alone() -> None:
    proposal = propose_speed(replace(FOUND, dead_zone_from=0.0), LOOP)
    assert proposal.throttle_min is None and any("MOT_THR_MIN 9" in words for words in proposal.remarks)


def test_margins_are_those_of_the_loop_in_time() -> None:
    """The loop oscillates for ever with the gain raised by the gain margin."""
    settings = SpeedSettings(2.0, 49.0, 0.6, 0.4, 0.0, 0.0)
    (found,) = margins_of(LOOP, [PLANT], settings)
    # the law without its limits: an impulse at the input of the loop
    dt, w = LOOP.period, 2 * np.pi * 10.0
    share = dt / (dt + 1 / w)

    def grows(factor: float) -> bool:
        v = error = total = 0.0
        a = np.exp(-dt / PLANT.lag)
        sent = [0.0] * round(PLANT.delay / dt)
        v, seen = 1.0, []
        for _ in range(4000):
            error += share * (-v - error)
            total += error * settings.i * dt
            sent.append(factor * (settings.p * error + total))
            v = a * v + (1 - a) * PLANT.gain * sent.pop(0)
            seen.append(abs(v))
        return max(seen[-500:]) > max(seen[500:1000])

    margin = 10 ** (found.gain_db / 20)
    assert not grows(0.95 * margin) and grows(1.05 * margin)


def test_cruise_throttle_holds_the_cruise_speed() -> None:
    speed, percent = cruise(LOOP, PLANT, 2.3)
    assert percent == round(percent)
    settings = SpeedSettings(speed, percent, 0.0, 0.0, 0.0, 1.0)
    driven = simulate_speed(LOOP, PLANT, settings, constant(speed), np.zeros(1), np.zeros(1))
    assert driven.speed[-1, 0] == pytest.approx(speed, abs=0.01)


def test_dead_zone_left_out_by_the_firmware_is_left_out_here() -> None:
    with_min = loop_with(MOT_THR_MIN=9.0)
    speed, percent = cruise(with_min, PLANT, 2.3)
    assert percent / 100 == pytest.approx((0.09 + 2.3 / 5.0 - 0.09) / 0.91, abs=0.01)
    settings = SpeedSettings(speed, percent, 0.0, 0.0, 0.0, 1.0)
    slower = simulate_speed(with_min, PLANT, settings, constant(0.5 * speed), np.zeros(1), np.zeros(1))
    assert slower.speed[-1, 0] == pytest.approx(0.5 * speed, abs=0.02), "the base is right at all speeds"


def test_integrator_holds_the_speed_on_a_slope() -> None:
    settings = SpeedSettings(2.0, 50.0, 0.5, 0.5, 0.0, 1.0)
    wanted = constant(2.0)
    push = np.full(wanted.size, -0.3)
    p, i = np.array([0.5, 0.5]), np.array([0.5, 0.0])
    driven = simulate_speed(LOOP, PLANT, settings, wanted, p, i, push)
    assert driven.speed[-1, 0] == pytest.approx(2.0, abs=0.005) and driven.speed[-1, 1] < 1.97


def test_acceleration_of_the_target_is_limited_on_both_sides() -> None:
    loop = loop_with(ATC_DECEL_MAX=0.5)
    wanted = np.r_[constant(1.0, seconds=1), constant(2.0, seconds=2), constant(1.0, seconds=3)]
    rate = np.diff(accelerated(loop, 2.0, wanted)) / loop.period
    assert rate.max() == pytest.approx(2.0) and rate.min() == pytest.approx(-0.5)


def test_acceleration_is_what_drive_and_drag_can_do() -> None:
    up = (5.0 * (1 - 0.09) - 3.1) / 0.7
    down = 1.7 + (1.5 - 0.8) / 0.7
    assert accel_limit(LOOP, FOUND) == pytest.approx(np.floor(10 * 0.75 * min(up, down)) / 10)
    assert accel_limit(loop_with(MOT_THR_MAX=75.0), FOUND) < accel_limit(LOOP, FOUND)


def test_slew_rate_is_simulated() -> None:
    settings = SpeedSettings(2.0, 50.0, 1.0, 0.5, 0.0, 0.0)
    fast = step_of_speed(loop_with(MOT_SLEWRATE=0), PLANT, settings, 1.5, 1.0)
    slow = step_of_speed(loop_with(MOT_SLEWRATE=20), PLANT, settings, 1.5, 1.0)
    assert slow.rise > 1.3 * fast.rise


def test_poor_identification_proposes_nothing() -> None:
    proposal = propose_speed(replace(FOUND, level="poor", reasons=("low coherence",)), LOOP)
    assert proposal.level == "none" and proposal.proposed is None and proposal.reasons == ("low coherence",)
    with pytest.raises(ValueError, match="no settings"):
        speed_text(proposal)


def test_long_delay_leaves_the_cruise_alone() -> None:
    ends = FOUND.intervals | {"delay": (0.1, 60.0)}
    proposal = propose_speed(replace(FOUND, intervals=ends), LOOP)
    assert proposal.level == "cruise only" and proposal.proposed is not None
    text = speed_text(proposal)
    assert "CRUISE_THROTTLE" in text and "\nATC_SPEED_P" not in text


def test_parameter_file_has_a_reason_on_every_line() -> None:
    text = speed_text(propose_speed(FOUND, LOOP))
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert [line.partition(",")[0] for line in lines] == [
        "CRUISE_SPEED",
        "CRUISE_THROTTLE",
        "ATC_SPEED_P",
        "ATC_SPEED_I",
        "ATC_SPEED_D",
        "ATC_ACCEL_MAX",
        "MOT_THR_MIN",
    ]
    assert all("  # " in line for line in lines)
    assert lines[-1].startswith("MOT_THR_MIN,6 ")


def test_impossible_parameters_are_named() -> None:
    with pytest.raises(ValueError, match="MOT_THR_MIN 50 and MOT_THR_MAX 40"):
        speed_loop({"MOT_THR_MIN": 50.0, "MOT_THR_MAX": 40.0})
