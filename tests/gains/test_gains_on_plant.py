"""The proposed gains on the nonlinear plant, behind controller, whole us of PWM and gyro filter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from acro_drive import limited_targets

from rover_sweep.data.recording import Array
from rover_sweep.gains.controller import BEFORE, RatePid, Step, simulated_step, step_metrics, step_target
from rover_sweep.gains.proposal import Proposal
from rover_sweep.gains.steering_chain import Autopilot, Gains
from sitl.plant.plant import Plant
from sitl.plant.sensors import LowPassFilter2p
from sitl.plant.variant import load_variant

RATE = 1200.0
THROTTLE = 1710.0
WARM = 6.0  # s to reach the speed
SMOOTH = {"road_force": 0.0, "road_yaw_moment": 0.0, "road_roll_moment": 0.0}


def on_the_plant(
    loop: Autopilot, gains: Gains, size: float, variant: str | Path = "nominal"
) -> tuple[Array, Array, float]:
    """(t, measured turn rate, speed) of a step on the plant at some 2.5 m/s; right is positive."""
    plant = Plant(replace(load_variant(variant), **SMOOTH))
    gyro, ticks = LowPassFilter2p(RATE, loop.gyro_hz), round(RATE / loop.loop_hz)
    for _ in range(round(WARM * RATE)):
        plant.step(1500.0, THROTTLE, 1 / RATE)
        gyro.apply(-plant.state.r)
    wanted = step_target(loop, size)
    pid = RatePid(gains, loop.period, *(np.array([g]) for g in (gains.p, gains.i, gains.ff)))
    limit, seen, measured = np.zeros(1, dtype=bool), [], gyro.apply(-plant.state.r)
    for target in limited_targets(loop, plant.state.vx, wanted):
        seen.append(measured)
        out = pid.update(float(target), np.array([measured]), limit) * loop.speed_scale(plant.state.vx)
        limit = np.abs(out) >= 1.0
        share = float(np.clip(out, -1, 1)[0])
        pwm = 1500 + int(share * (loop.us_right if share > 0 else loop.us_left))
        for _ in range(ticks):
            plant.step(pwm, THROTTLE, 1 / RATE)
            measured = gyro.apply(-plant.state.r)
    return np.arange(wanted.size) * loop.period, np.array(seen), plant.state.vx


def model_step(proposal: Proposal, size: float) -> Step:
    from rover_sweep.gains.proposal import family_of

    family = family_of(replace(proposal.found, intervals={}), proposal.autopilot, proposal.speed)
    driven = simulated_step(
        proposal.autopilot, family.nominal, family.angle_per_output[0], proposal.proposed.gains, size
    )
    return step_metrics(driven.t - BEFORE, driven.target, driven.rate[:, 0], size)


@pytest.mark.parametrize("size", [0.3, -0.5])
def test_the_step_comes_as_predicted(proposal: Proposal, size: float):
    loop = proposal.autopilot
    t, rate, speed = on_the_plant(loop, proposal.proposed.gains, size)
    assert speed == pytest.approx(2.5, abs=0.1)
    target = limited_targets(loop, speed, step_target(loop, size))
    seen, told = step_metrics(t - BEFORE, target, rate, size), model_step(proposal, size)
    assert seen.overshoot == pytest.approx(told.overshoot, abs=3.0)
    assert seen.rise == pytest.approx(told.rise, abs=0.02)


def test_the_defaults_do_not_get_there(proposal: Proposal):
    """What the proposal is for: the firmware's own gains end far below the target within the same time."""
    t, rate, _ = on_the_plant(proposal.autopilot, proposal.autopilot.gains, 0.5)
    assert rate[-1] < 0.4 < 0.5 * 0.97 < on_the_plant(proposal.autopilot, proposal.proposed.gains, 0.5)[1][-1]
    assert t[-1] > 3.0
