"""The proposed speed loop: margins by a second formula, limits of the firmware, refusals in words."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from firmware_params.param_files import parse
from rover_sweep.cli.main import cli, run
from rover_sweep.gains.corner import CORNER, corner_path, corners
from rover_sweep.gains.gains_json import limits_text, speed_text
from rover_sweep.gains.proposal import Proposal, SteeringLimits, family_of, steering_limits
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
from rover_sweep.report.gains_report import gains_report
from rover_sweep.report.on_terminal import on_terminal

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
PARAMETERS = ("CRUISE_SPEED", "CRUISE_THROTTLE", *(f"ATC_SPEED_{n}" for n in "PID"), "ATC_ACCEL_MAX")


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
    assert [line.partition(",")[0] for line in lines] == [*PARAMETERS, "MOT_THR_MIN"]
    assert all("  # " in line for line in lines)
    assert lines[-1].startswith("MOT_THR_MIN,6 ")


def test_impossible_parameters_are_named() -> None:
    with pytest.raises(ValueError, match="MOT_THR_MIN 50 and MOT_THR_MAX 40"):
        speed_loop({"MOT_THR_MIN": 50.0, "MOT_THR_MAX": 40.0})


# ---- identify recognises a throttle sweep, and gains proposes the speed loop from it.

DATA = Path(__file__).parents[1] / "data"
SWEEP = DATA / "ardurover-4.6.3" / "throttle" / "sweep.BIN"


def called(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(cli, [str(a) for a in arguments])
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("speed")
    code, printed, said = called("identify", SWEEP, "--out", out)
    assert code == 0, said
    assert printed.startswith("GOOD\nATC_SPEED_P")
    assert "dead zone" in printed and "coasting" in printed
    return out


def test_gains_of_the_speed(report: Path, tmp_path: Path) -> None:
    file = tmp_path / "speed.param"
    code, printed, said = called("gains", report, "--out", file)
    assert code == 0, said
    assert "Speed loop for 1.54 to 3.01 m/s" in printed and "overshoot" in printed
    written = {p.name: p.value for p in parse(file.read_text())}
    assert written.keys() == set(PARAMETERS)
    assert 0.5 < written["ATC_SPEED_P"] < 2.0


def test_gains_as_json(report: Path) -> None:
    code, printed, _ = called("gains", report / "speed.json", "--json")
    document = json.loads(printed)
    assert code == 0 and document["format"] == "rover-sweep gains"
    assert document["speed_loop"]["proposed"]["worst_gain_margin_db"] >= 6
    assert "limits" not in document


def test_damaged_speed_file_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "speed.json").write_text('{"law": null}')
    assert run(["gains", str(tmp_path)]) != 0
    assert "no speed gains can be computed from" in capsys.readouterr().err


# ---- The path round a 90 degree corner with a rover's gains and limits.

SPEED = 2.5


def path(proposal: Proposal, rate_max: float, gains=None):
    loop = replace(proposal.autopilot, rate_max=math.radians(rate_max))
    family = family_of(replace(proposal.found, intervals={}), loop, SPEED)
    return corner_path(loop, family.nominal, family.angle_per_output[0], gains or proposal.proposed.gains)


def test_the_path_is_a_circle_between_two_straight_lines(proposal: Proposal):
    rate, ahead, aside = path(proposal, 40.0)
    assert math.degrees(rate) == pytest.approx(40.0, rel=0.08)
    along, across = np.gradient(ahead), np.gradient(aside)
    heading = np.unwrap(np.arctan2(across, along))
    assert heading[-1] == pytest.approx(CORNER, abs=0.01)
    middle = (heading > 0.5) & (heading < 1.0)
    curvature = np.gradient(heading)[middle] / np.hypot(along, across)[middle]
    assert 1 / np.median(curvature) == pytest.approx(SPEED / math.radians(40.0), rel=0.05)
    assert ahead[-1] > SPEED / math.radians(40.0), "the limits of the acceleration make it longer"


def test_the_corridor_is_left_where_the_path_is_off_the_legs(proposal: Proposal):
    limits = steering_limits(proposal)
    found = corners(proposal, limits)
    assert [(round(c.speed, 2), c.gains) for c in found[::2]] == [(1.67, "now"), (2.5, "now"), (3.75, "now")]
    proposed = next(c for c in found if c.gains == "proposed" and c.speed == SPEED)
    for width, inside in ((1.05 * proposed.off, True), (0.8 * proposed.off, False)):
        (again,) = (c for c in corners(proposal, limits, width) if c.gains == "proposed" and c.speed == SPEED)
        assert (again.leaves is None) == inside
    assert again.leaves is not None and again.returns is not None
    assert -proposed.before < again.leaves < 0 < again.returns and not again.wide


def test_gains_that_turn_too_late_swing_wide(proposal: Proposal):
    """The firmware's defaults hold a third of the turn rate until the integrator has grown."""
    now = next(c for c in corners(proposal, None) if c.gains == "now" and c.speed == SPEED)
    assert now.wide and now.leaves is not None and now.leaves > 0
    assert now.off > 1.5


def test_the_table_is_in_the_answer(proposal: Proposal):
    from rich.console import Console

    limits = steering_limits(proposal)
    console = Console(width=140)
    with console.capture() as capture:
        console.print(on_terminal(gains_report(proposal, limits, corners(proposal, limits))))
    said = capture.get()
    assert "A corner of 90 degrees" in said and "corridor of +-1 m" in said
    assert "swings wide from" in said and "stays in it" in said


# ---- ATC_STR_RAT_MAX from the steering's stops, ATC_TURN_MAX_G from the runs; never lowered unasked.


def limits_of(of: Proposal, largest_us: float | None) -> SteeringLimits:
    found = steering_limits(replace(of, found=replace(of.found, largest_us=largest_us)))
    assert found is not None
    return found


def test_limits_by_hand(proposal: Proposal) -> None:
    assert proposal.steady_gain is not None
    per_us = proposal.steady_gain * 0.00095
    found = limits_of(proposal, 240.0)
    travel = min(proposal.autopilot.us_left, proposal.autopilot.us_right)
    assert found.reach == pytest.approx(57.2958 * per_us * travel, rel=1e-3)
    assert found.rate_max == pytest.approx(0.9 * found.reach, abs=1)
    assert found.turn_g == pytest.approx(per_us * 240 * proposal.speed / 9.80665, abs=0.01)


def test_lower_limit_is_a_comment_and_a_higher_one_is_not(proposal: Proposal) -> None:
    low, high = (limits_of(proposal, us) for us in (100.0, 400.0))
    assert replace(low, now_g=0.6).lowers and not replace(high, now_g=0.1).lowers
    assert "\n# ATC_TURN_MAX_G" in limits_text(replace(low, now_g=0.6), {})
    assert "\nATC_TURN_MAX_G" in limits_text(replace(high, now_g=0.1), {"ATC_TURN_MAX_G": 0.1})


def test_unknown_amplitude_leaves_the_lateral_limit_out(proposal: Proposal) -> None:
    assert "ATC_TURN_MAX_G" not in limits_text(limits_of(proposal, None), {})


def test_no_gains_no_limits(proposal: Proposal) -> None:
    assert steering_limits(replace(proposal, proposed=None)) is None


def test_slew_rate_is_simulated() -> None:
    settings = SpeedSettings(2.0, 50.0, 1.0, 0.5, 0.0, 0.0)
    fast = step_of_speed(loop_with(MOT_SLEWRATE=0), PLANT, settings, 1.5, 1.0)
    slow = step_of_speed(loop_with(MOT_SLEWRATE=20), PLANT, settings, 1.5, 1.0)
    assert slow.rise > 1.3 * fast.rise
