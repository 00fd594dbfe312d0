"""What the real firmware did with the proposed gains, judged again from its log."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from acro_drive import FULL, judge, limited_targets, predicted, segments

from rover_sweep.data.recording import Array
from rover_sweep.gains.controller import BEFORE, RatePid, Step, simulated_step, step_metrics, step_target
from rover_sweep.gains.proposal import Proposal, propose_gains
from rover_sweep.gains.steering_chain import Autopilot, Gains, autopilot
from rover_sweep.logs.readers.dataflash import DataFlash, index
from rover_sweep.logs.readers.dataflash_channels import read_dataflash
from sitl.plant.plant import Plant
from sitl.plant.sensors import LowPassFilter2p
from sitl.plant.variant import load_variant

RECORDED = Path(__file__).parents[1] / "data" / "gains" / "ardurover-4.6.3"
LOG = RECORDED / "acro.BIN"
FLOWN = segments(RECORDED / "acro.json")


@pytest.fixture(scope="module")
def flash() -> DataFlash:
    return index(np.fromfile(LOG, np.uint8))


@pytest.fixture(scope="module")
def loop() -> Autopilot:
    return autopilot(read_dataflash(LOG)[-1].parameters)


def gains_of(name: str) -> Gains:
    return autopilot(FLOWN[name].parameters).gains


def during(flash: DataFlash, message: str, name: str) -> tuple[Array, dict[str, Array]]:
    """(t from the start of a segment [s], columns) within it."""
    t = flash.seconds(message) - FLOWN[name].start
    inside = (t >= 0) & (t < FULL.length)
    columns = flash.formats[message].columns[1:]
    return t[inside], {c: flash.column(message, c)[inside] for c in columns}


def test_the_tracking_error_is_more_than_halved():
    before, after = (judge(LOG, FLOWN[name]) for name in ("defaults", "proposed"))
    assert before.speed == pytest.approx(after.speed, abs=0.05) == pytest.approx(2.45, abs=0.05)
    assert math.degrees(before.rms) == pytest.approx(15.3, abs=0.3)
    assert after.rms < before.rms / 4


def test_the_step_came_as_predicted_and_the_defaults_never_got_there(proposal: Proposal, loop: Autopilot):
    """From an identification that has seen none of this."""
    seen, told = judge(LOG, FLOWN["proposed"]).step, predicted(proposal, loop, gains_of("proposed"))
    assert seen.overshoot == pytest.approx(told.overshoot, abs=2.0)
    assert seen.rise == pytest.approx(told.rise, abs=0.02)
    assert seen.settling == pytest.approx(told.settling, abs=0.1)
    seen, told = judge(LOG, FLOWN["defaults"]).step, predicted(proposal, loop, gains_of("defaults"))
    assert math.isnan(seen.rise) and math.isnan(told.rise)
    assert seen.lag == pytest.approx(told.lag, rel=0.1)


def test_the_flown_gains_are_still_what_is_proposed(proposal: Proposal):
    for name, value in proposal.proposed.gains.parameters.items():
        assert value == pytest.approx(FLOWN["proposed"].parameters[name], rel=0.15), name


def test_the_flown_gains_are_the_fourth_step_from_the_defaults(proposal: Proposal):
    """As the caption of docs/pictures/proof.svg says."""
    loop, steps = proposal.autopilot, []
    for _ in range(4):
        made = propose_gains(proposal.found, loop, proposal.speed).proposed
        assert made is not None
        steps.append(made)
        loop = replace(loop, gains=made.gains)
    assert math.isnan(steps[0].step.rise)
    for name, value in steps[3].gains.parameters.items():
        assert value == pytest.approx(FLOWN["proposed"].parameters[name], rel=0.15), name
    assert steps[2].gains.i < 0.9 * steps[3].gains.i


@pytest.mark.parametrize("name", ["defaults", "proposed"])
def test_the_controller_is_the_firmwares(flash: DataFlash, name: str):
    """P, I and FF of every main loop in the log, computed again from target and measurement."""
    t, logged = during(flash, "PIDS", name)
    gains, none = gains_of(name), np.zeros(1, dtype=bool)
    pid = RatePid(gains, float(np.mean(np.diff(t))), *(np.array([g]) for g in (gains.p, gains.i, gains.ff)))
    pid.fresh = False
    pid.target, pid.error = np.array([logged["Tar"][0]]), np.array([logged["Err"][0]])
    pid.integrator = np.array([logged["I"][0]])
    for k in range(1, t.size):
        pid.update(float(logged["Tar"][k]), np.array([logged["Act"][k]]), none)
        assert pid.error[0] * gains.p == pytest.approx(logged["P"][k], abs=2e-3)
        assert pid.integrator[0] == pytest.approx(logged["I"][k], abs=5e-3)
        assert pid.target[0] * gains.ff == pytest.approx(logged["FF"][k], abs=1e-5)


# ---- The proposed gains on the nonlinear plant, behind controller, whole us of PWM and gyro filter.

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


def test_the_step_comes_as_predicted_and_the_defaults_do_not_get_there(proposal: Proposal):
    loop, size = proposal.autopilot, -0.5
    t, rate, speed = on_the_plant(loop, proposal.proposed.gains, size)
    assert speed == pytest.approx(2.5, abs=0.1)
    target = limited_targets(loop, speed, step_target(loop, size))
    seen, told = step_metrics(t - BEFORE, target, rate, size), model_step(proposal, size)
    assert seen.overshoot == pytest.approx(told.overshoot, abs=3.0)
    assert seen.rise == pytest.approx(told.rise, abs=0.02)
    defaults = on_the_plant(loop, loop.gains, size)[1]
    assert defaults[-1] > -0.4 and rate[-1] < -0.5 * 0.97
