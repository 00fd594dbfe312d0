"""What the real firmware did with the proposed gains, judged again from its log."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from acro_drive import EACH, FULL, STEP, Profile, judge, predicted, segments

from rover_sweep.data.recording import Array
from rover_sweep.gains.controller import RatePid
from rover_sweep.gains.proposal import Proposal
from rover_sweep.gains.steering_chain import DEFAULTS, Autopilot, Gains, autopilot
from rover_sweep.logs.readers.dataflash import DataFlash, index
from rover_sweep.logs.readers.dataflash_channels import read_dataflash

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


def test_the_step_came_as_predicted(proposal: Proposal, loop: Autopilot):
    """From an identification that has seen none of this."""
    seen, told = judge(LOG, FLOWN["proposed"]).step, predicted(proposal, loop, gains_of("proposed"))
    assert seen.overshoot == pytest.approx(told.overshoot, abs=2.0)
    assert seen.rise == pytest.approx(told.rise, abs=0.02)
    assert seen.settling == pytest.approx(told.settling, abs=0.1)


def test_the_defaults_never_got_there_as_predicted(proposal: Proposal, loop: Autopilot):
    seen, told = judge(LOG, FLOWN["defaults"]).step, predicted(proposal, loop, gains_of("defaults"))
    assert math.isnan(seen.rise)
    assert math.isnan(told.rise)
    assert seen.lag == pytest.approx(told.lag, rel=0.1)


def test_the_flown_gains_are_still_what_is_proposed(proposal: Proposal):
    for name, value in proposal.proposed.gains.parameters.items():
        assert value == pytest.approx(FLOWN["proposed"].parameters[name], rel=0.15), name


def test_what_was_flown_is_the_firmwares_default():
    for name, value in FLOWN["defaults"].parameters.items():
        assert value == pytest.approx(DEFAULTS[name]), name


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


@pytest.mark.parametrize("name", ["defaults", "proposed"])
def test_the_steering_is_scaled_by_the_speed(flash: DataFlash, loop: Autopilot, name: str):
    """RCOU against STER.SteerOut: scaled by MOT_SPD_SCA_BASE / speed, in whole us."""
    t, steering = during(flash, "STER", name)
    at, throttle = during(flash, "THR", name)
    speed = np.interp(t, at, throttle["Speed"])
    pwm = during(flash, "RCOU", name)[1]["C1"] - 1500
    share = steering["SteerOut"] / 4500
    scaled = np.array([s * loop.speed_scale(v) for s, v in zip(share, speed, strict=True)])
    assert np.sqrt(np.mean((scaled * loop.us_right - pwm) ** 2)) < 3.0  # the two are logged some ms apart
    large = np.abs(share) > 0.2
    assert np.median(pwm[large] / (share[large] * loop.us_right)) == pytest.approx(1 / 2.45, rel=0.03)


def test_the_target_is_the_stick_behind_the_acceleration_limit(flash: DataFlash, loop: Autopilot):
    t, logged = during(flash, "PIDS", "proposed")
    slope = np.abs(np.diff(logged["Tar"]) / np.diff(t))
    assert np.percentile(slope, 99) == pytest.approx(loop.accel_max, rel=0.02)
    settled = (t % EACH > 1.0) & (t % EACH < 2.8) & (t < FULL.steps * EACH)
    asked = np.array([FULL.rate(x) for x in t[settled]])
    assert logged["Tar"][settled] == pytest.approx(asked, abs=0.005)
    assert np.abs(asked).max() == pytest.approx(STEP)


def test_turn_rates_of_ster_are_those_of_pids(flash: DataFlash):
    """STER in deg/s, PIDS in rad/s, of the same tick or the one beside."""
    t, slow = during(flash, "STER", "proposed")
    fine, fast = during(flash, "PIDS", "proposed")
    for ster, pids in (("DesTurnRate", "Tar"), ("TurnRate", "Act")):
        assert np.radians(slow[ster]) == pytest.approx(np.interp(t, fine, fast[pids]), abs=0.06)


@pytest.mark.ardurover
def test_a_short_drive_on_the_firmware(proposal: Proposal, tmp_path: Path):
    """Two steps each, as fast as the machine allows; the parameters read over the link by the command too."""
    from acro_on_firmware import drive

    from sitl.launcher import LaunchError, find_ardurover

    try:
        binary = find_ardurover()
    except LaunchError as error:
        pytest.skip(str(error))
    short = Profile(steps=2, sine_s=4.0)
    log, told, loop = drive(
        binary, tmp_path, {"defaults": {}, "proposed": proposal.proposed.gains.parameters}, short, speedup=4.0
    )
    before, after = (judge(log, segment, short) for segment in told)
    assert after.rms < before.rms / 2
    assert after.step.overshoot == pytest.approx(
        predicted(proposal, loop, proposal.proposed.gains).overshoot, abs=6
    )
