"""`gains --check`: what it finds in drives with wrong gains and limits, and in well tuned ones."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from acro_drive import FULL, segments

from rover_sweep.api.driving import identify_driving
from rover_sweep.api.gains import check_gains
from rover_sweep.cli.main import run
from rover_sweep.data.controller_log import ControllerLog
from rover_sweep.data.recording import Array
from rover_sweep.gains.check import SteeringCheck, check_speed, check_steering
from rover_sweep.gains.controller import simulate_loop
from rover_sweep.gains.first import first_feed_forward
from rover_sweep.gains.proposal import Proposal, family_of
from rover_sweep.gains.steering_chain import DEFAULTS, Gains, autopilot
from rover_sweep.gains.tracking import even_stretches, held_feed_forward
from rover_sweep.gains.tuning import feed_forward
from rover_sweep.logs.controllers import read_controllers
from rover_sweep.logs.read import read_logs
from rover_sweep.report.gains_check_report import check_report, first_report

DATA = Path(__file__).parents[1] / "data"
RECORDED = DATA / "gains" / "ardurover-4.6.3"
CHANGED = RECORDED / "acro.BIN"
"""A drive with the firmware's defaults, then with the proposal, in one log."""
SPEED, NOISE = 2.5, 0.005  # m/s, rad/s
SLOPE = 0.01  # rad at the wheels, slowly changing


def driven(
    proposal: Proposal, gains: Gains, speed: float = SPEED, slope: float = SLOPE, **parameters: float
) -> ControllerLog:
    """The log of a simulated drive of the profile on the identified model."""
    known = {
        **DEFAULTS,
        **{"SCHED_LOOP_RATE": 100.0, "INS_GYRO_FILTER": 20.0},
        **gains.parameters,
        **parameters,
    }
    loop = autopilot(known)
    family = family_of(replace(proposal.found, intervals={}), loop, abs(speed))
    t = np.arange(0.0, FULL.length, loop.period)
    wanted = np.array([FULL.rate(x) for x in t])
    pushed = slope * np.sin(2 * np.pi * 0.1 * t)
    p, i, ff = (np.array([g]) for g in (gains.p, gains.i, gains.ff))
    drive = simulate_loop(loop, family.nominal, family.angle_per_output[0], wanted, p, i, ff, gains, pushed)
    rate = drive.rate[:, 0] + NOISE * np.random.default_rng(1).standard_normal(t.size)
    fed, fast = drive.target * gains.ff, (drive.target - rate) * gains.p
    rest = drive.steering[:, 0] / loop.speed_scale(speed) - fed - fast
    still = np.zeros(t.size)
    return ControllerLog("drive", t, drive.target, rate, fast, rest, still, fed, still + speed, known)


def found(check: SteeringCheck) -> list[tuple[str, str]]:
    return [(f.name, f.parameter) for f in check.findings]


@pytest.fixture(scope="module")
def tuned(proposal: Proposal) -> Gains:
    assert proposal.proposed is not None
    return proposal.proposed.gains


def test_nothing_is_found_in_a_well_tuned_loop(proposal: Proposal, tuned: Gains):
    check = check_steering(driven(proposal, tuned), proposal.found)
    assert not check.findings and not check.skipped
    assert check.predicted is not None and check.after is None
    assert check.predicted.rms == pytest.approx(check.achieved.rms, rel=0.25)
    assert check.predicted.lag == pytest.approx(check.achieved.lag, abs=0.03)
    assert check.predicted.overshoot == pytest.approx(check.achieved.overshoot, abs=4.0)


@pytest.mark.parametrize(
    ("factor", "name", "speed"), [(0.5, "FF too low", -SPEED), (2.0, "FF too high", 1.8)]
)
def test_half_and_double_feed_forward_are_found(
    proposal: Proposal, tuned: Gains, factor: float, name: str, speed: float
):
    """In reverse too: a negative speed is a speed."""
    check = check_steering(driven(proposal, replace(tuned, ff=factor * tuned.ff), speed))
    assert found(check) == [(name, "ATC_STR_RAT_FF")]
    assert check.speed == pytest.approx(speed)
    assert check.feed_forward is not None
    value, low, high = check.feed_forward
    assert low < value < high and high - low < 0.2 * value
    right = check.findings[0].value
    assert right == pytest.approx(tuned.ff, rel=0.15), "the change leads back to the design"
    assert check.after is not None and check.after.rms < check.achieved.rms


@pytest.mark.parametrize("was_reversed", [0.0, 1.0])
def test_a_reversed_servo_is_named_and_not_an_unexplained_turn(was_reversed: float):
    """The controller drives the steering to a stop, as every output makes the error larger."""
    t = np.arange(0.0, 60.0, 0.02)
    target = 0.5 * np.sin(2 * np.pi * 0.1 * t)
    travel = np.clip(2.0 * target, -1.0, 1.0)
    rate = -np.interp(t - 0.2, t, travel) * 1.2  # to the other side
    known = {**DEFAULTS, "MOT_SPD_SCA_BASE": 0.0, "SERVO1_FUNCTION": 26.0, "SERVO1_REVERSED": was_reversed}
    still = np.zeros(t.size)
    log = ControllerLog("drive", t, target, rate, travel, still, still, still, still + SPEED, known)
    check = check_steering(log)
    assert found(check) == [("steering reversed", "SERVO1_REVERSED")]
    (fault,) = check.findings
    assert (fault.now, fault.value) == (was_reversed, 1.0 - was_reversed)
    assert "correlation -0.9" in fault.words or "correlation -1.0" in fault.words
    assert not any("explains only" in words for words in check.skipped)
    said = [part.text for part in check_report(((), ()), ([check], ())).answer]
    assert said[0].startswith(f"Next: set SERVO1_REVERSED to {1 - was_reversed:g}")


def test_a_turn_held_at_the_wrong_stop_is_reversed_too():
    """What such a loop really does: it winds up to one stop and stays there."""
    t = np.arange(0.0, 30.0, 0.02)
    target = np.where(t < 1.0, 0.0, 0.5)
    still, full = np.zeros(t.size), np.where(t < 1.5, 0.0, 1.0)
    rate = -1.2 * full + 0.01 * np.random.default_rng(1).standard_normal(t.size)
    log = ControllerLog("drive", t, target, rate, full, still, still, still, still + SPEED, {**DEFAULTS})
    assert found(check_steering(log)) == [("steering reversed", "SERVO1_REVERSED")]


def test_turns_held_at_the_stops_give_a_first_feed_forward():
    """FF so large that the steering goes from stop to stop: it has no response to fit, but a steady turn."""
    t = np.arange(0.0, 60.0, 0.02)
    target = 0.5 * np.sign(np.sin(2 * np.pi * 0.1 * t))
    gain, scale = 0.6, 1.0 / SPEED  # 1/m for the whole travel; MOT_SPD_SCA_BASE 1
    known = {**DEFAULTS, "ATC_STR_RAT_FF": 12.0}
    output = np.where(t < 30, 1.0, -1.0) * 6.0  # two long turns, each at a stop
    rng = np.random.default_rng(1)
    steady = gain * SPEED * np.clip(output * scale, -1, 1)
    rate = steady + 0.02 * rng.standard_normal(t.size)
    still = np.zeros(t.size)
    log = ControllerLog("drive", t, target, rate, still, still, still, output, still + SPEED, known)
    check = check_steering(log)
    assert check.feed_forward is not None
    value, low, high = check.feed_forward
    truth = 1 / (gain * SPEED * scale)
    assert low < truth < high and high - low < 0.4 * value
    assert ("FF too high", "ATC_STR_RAT_FF") in found(check)
    assert not check.skipped


def test_no_held_turn_gives_no_feed_forward(proposal: Proposal, tuned: Gains):
    """Quick steering about straight: nothing is held."""
    log = driven(proposal, tuned)
    quick = replace(log, ff=0.2 * np.sin(9.0 * log.t), p=0 * log.t, i=0 * log.t)
    parts = even_stretches(quick)
    assert held_feed_forward(parts, autopilot(log.parameters)) is None


def test_an_oscillating_p_is_halved(proposal: Proposal, tuned: Gains):
    too_much = 1.1 * tuned.p * 10 ** (proposal.proposed.margins.gain_db / 20)
    check = check_steering(driven(proposal, replace(tuned, p=too_much)))
    assert found(check)[0] == ("oscillates", "ATC_STR_RAT_P")
    assert check.findings[0].value == pytest.approx(too_much / 2, rel=0.01)
    assert check.oscillation is not None
    crossing = proposal.proposed.margins.phase_crossover / (2 * math.pi)
    assert check.oscillation.hz == pytest.approx(crossing, rel=0.3)
    assert check.after is not None and check.after.rms < check.achieved.rms / 2


@pytest.mark.parametrize(
    ("name", "value"), [("ATC_STR_RAT_MAX", 20.0), ("ATC_TURN_MAX_G", 0.1), ("ATC_STR_ACC_MAX", 20.0)]
)
def test_a_limit_that_is_hit_is_named(proposal: Proposal, tuned: Gains, name: str, value: float):
    check = check_steering(driven(proposal, tuned, **{name: value}))
    assert found(check) == [("limit hit", name)]
    assert value < check.findings[0].value <= 2 * value
    assert next(limit for limit in check.limits if limit.parameter == name).seconds > 15


def test_a_model_that_may_lack_the_servo_predicts_nothing(proposal: Proposal, tuned: Gains):
    check = check_steering(driven(proposal, tuned), replace(proposal.found, has_servo=False))
    assert check.predicted is None and not check.findings
    assert any("the prediction" in words and "lack the servo" in words for words in check.skipped)


def test_a_drive_without_turns_is_not_judged(proposal: Proposal, tuned: Gains):
    log = driven(proposal, tuned)
    straight = replace(log, target=0.01 * log.target, actual=0.01 * log.actual)
    check = check_steering(straight)
    assert not check.findings and "too little to judge" in check.skipped[0]


def test_a_base_throttle_that_does_not_hold_the_speed_is_found():
    """CRUISE_THROTTLE 30 %, where 50 % hold the speed: the integrator supplies the rest."""
    t = np.arange(0.0, 60.0, 0.02)
    target = np.where(t % 20 < 10, 2.0, 2.5)
    actual: Array = target - 0.3 * np.exp(-(t % 10) / 0.8)
    base = 0.3 * target / 2.0
    known = {"CRUISE_SPEED": 2.0, "CRUISE_THROTTLE": 30.0, "ATC_SPEED_P": 0.2, "ATC_SPEED_I": 0.2}
    still = np.zeros(t.size)
    log = ControllerLog(
        "drive", t, target, actual, still, 0.5 * actual / 2.0 - base, still, base, actual, known
    )
    check = check_speed(log)
    assert check is not None and check.cruise is not None
    assert [(f.parameter, f.value) for f in check.findings] == [("CRUISE_THROTTLE", 50)]
    assert not check_speed(replace(log, parameters={**known, "CRUISE_THROTTLE": 50.0})).findings


def test_five_drives_on_the_firmware_are_judged_right():
    """Recorded on ArduRover 4.6.3 with a drawn rover: well tuned, and four faults."""
    names, logs = segments(RECORDED / "check.json"), read_controllers(RECORDED / "check.BIN").steering
    checks = {name: check_steering(log) for name, log in zip(names, logs, strict=True)}
    assert {name: found(check) for name, check in checks.items()} == {
        "tuned": [],
        "half": [("FF too low", "ATC_STR_RAT_FF")],
        "double": [("FF too high", "ATC_STR_RAT_FF")],
        "swings": [("oscillates", "ATC_STR_RAT_P")],
        "limit": [("limit hit", "ATC_STR_RAT_MAX")],
    }
    right = checks["tuned"].autopilot.gains
    for name in ("half", "double"):
        assert checks[name].findings[0].value == pytest.approx(right.ff, rel=0.1)
    assert checks["swings"].findings[0].value < 0.6 * checks["swings"].autopilot.gains.p
    assert checks["swings"].oscillation.hz == pytest.approx(5.2, abs=0.5)


def test_telemetry_shows_the_same_as_the_log():
    """PID_TUNING of the firmware at 20 Hz, in deg/s."""
    (log,) = read_controllers(RECORDED / "half.tlog").steering
    by_log = read_controllers(RECORDED / "check.BIN").steering[1]
    assert log.parameters["ATC_STR_RAT_FF"] == by_log.parameters["ATC_STR_RAT_FF"]
    one, other = check_steering(log), check_steering(by_log)
    assert found(one) == found(other) == [("FF too low", "ATC_STR_RAT_FF")]
    assert one.feed_forward[0] == pytest.approx(other.feed_forward[0], rel=0.05)
    assert one.speed == pytest.approx(other.speed, abs=0.1)


def test_both_directions_are_checked_apart(proposal: Proposal, tuned: Gains):
    """A rover that follows forward and not in reverse (discuss.ardupilot.org/t/29463)."""
    forward, reverse = driven(proposal, tuned), driven(proposal, replace(tuned, ff=tuned.ff / 2), -SPEED)
    columns = ("target", "actual", "p", "i", "d", "ff", "speed")
    later = reverse.t + forward.t[-1] + 5.0
    both = replace(
        forward,
        t=np.concatenate((forward.t, later)),
        **{name: np.concatenate((getattr(forward, name), getattr(reverse, name))) for name in columns},
    )
    ahead, back = both.stretches([])
    assert not ahead.reverse and back.reverse
    checks = [check_steering(log) for log in (ahead, replace(back, parameters=reverse.parameters))]
    assert [found(check) for check in checks] == [[], [("FF too low", "ATC_STR_RAT_FF")]]
    said = "\n".join(part.text for part in check_report(((), ()), (checks, ())).answer)
    assert "FF too low in reverse:" in said


def test_a_log_with_changed_gains_is_before_and_after(capsys: pytest.CaptureFixture[str]):
    """Recorded on ArduRover 4.6.3: the defaults, then the proposal."""
    assert run(["gains", "--check", str(CHANGED), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    (before,), (after,) = (told[when]["steering"] for when in ("before", "now"))
    assert [f["name"] for f in before["findings"]] == ["FF too low"] and not after["findings"]
    assert before["gains"]["ATC_STR_RAT_FF"] == pytest.approx(0.2)
    assert after["feed_forward"]["low"] < 1.05 < after["feed_forward"]["high"]
    assert after["achieved"]["overshoot"] == pytest.approx(7.8, abs=1.0)
    assert run(["gains", "--check", str(RECORDED / "half.tlog"), "--check", str(CHANGED)]) == 0
    said = capsys.readouterr().out
    assert "before: half" in said and "after: acro" in said and "CRUISE_THROTTLE needed" in said
    assert "times smaller after than before" in said


@pytest.mark.parametrize(("name", "words"), [("run1.BIN", "LOG_BITMASK"), ("run1.tlog", "GCS_PID_MASK to 3")])
def test_a_log_without_the_controller_gives_a_first_ff_and_says_how_to_log_it(
    name: str, words: str, capsys: pytest.CaptureFixture[str]
):
    """A drive in MANUAL: the rover's curvature, its servo's ends and MOT_SPD_SCA_BASE give FF."""
    assert run(["gains", "--check", str(DATA / "ardurover-4.6.3" / "nominal" / name)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert words in said and "ACRO or AUTO" in said and "P, I and the limits were not checked" in said
    assert "ATC_STR_RAT_FF that holds a turn at 2.5 m/s" in said
    assert ("the log lacks" in said and "SERVO1_MIN" in said) == name.endswith(".tlog")


def test_the_first_ff_is_that_of_the_model(proposal: Proposal):
    """Of the same rover, with the servo's ends of that log: FF of a steady turn at that speed."""
    path = DATA / "ardurover-4.6.3" / "nominal" / "run1.BIN"
    first = check_gains([path]).first
    assert first is not None and not first.reversed_servo and not first.assumed
    loop = autopilot(read_logs(str(path))[-1].parameters)
    family = family_of(replace(proposal.found, intervals={}), loop, first.speed)
    assert first.value == pytest.approx(feed_forward(family), rel=0.05)
    assert first.low < first.value < first.high and first.high - first.low < 0.1 * first.value
    assert first.next == pytest.approx(first.value, rel=0.01) and not first.fits


def test_a_rover_that_turns_against_its_servo_is_told_in_manual_too():
    path = DATA / "ardurover-4.6.3" / "nominal" / "run1.BIN"
    answer = identify_driving(path)
    known = dict(read_logs(str(path))[-1].parameters)
    turned = autopilot({**known, "SERVO1_REVERSED": 1.0 - known.get("SERVO1_REVERSED", 0.0)})
    first = first_feed_forward(answer, turned, "run1", "MANUAL")
    assert first is not None and first.reversed_servo == "SERVO1_REVERSED"
    said = [part.text for part in first_report(first).answer]
    assert said[0].startswith("Next: turn SERVO1_REVERSED over")


def test_a_log_that_shows_no_turns_says_how_to_log_the_controller(capsys: pytest.CaptureFixture[str]):
    assert run(["gains", "--check", str(DATA / "ardurover-4.6.3" / "throttle" / "sweep.BIN")]) == 3
    said = capsys.readouterr().err
    assert "LOG_BITMASK" in said and said.count("\n") == 1


def test_without_parameters_the_gains_come_from_the_terms(proposal: Proposal, tuned: Gains):
    """As in a .tlog that was begun after the parameters were read."""
    log = driven(proposal, replace(tuned, ff=tuned.ff / 2))
    check = check_steering(replace(log, parameters={}))
    assert found(check) == [("FF too low", "ATC_STR_RAT_FF")]
    assert check.autopilot.gains.ff == pytest.approx(tuned.ff / 2, rel=0.01)
    said = [part.text for part in check_report(((), ()), ([check], ())).answer]
    assert any("Assumed at the firmware's defaults" in text for text in said)


def test_the_first_ff_is_in_the_json_document(capsys: pytest.CaptureFixture[str]):
    assert run(["gains", "--check", str(DATA / "ardurover-4.6.3" / "nominal" / "run1.BIN"), "--json"]) == 0
    first = json.loads(capsys.readouterr().out)["first"]
    assert first["low"] < first["value"] < first["high"] and first["reversed_servo"] == ""


AUTO, LOITER, ACRO = 10.0, 5.0, 1.0
POSITION = {"PSC_POS_P": 0.2, "PSC_VEL_P": 1.0}


def swinging(proposal: Proposal, tuned: Gains, mode: float, hz: float = 0.2, **known: float) -> ControllerLog:
    """A well tuned loop that follows a target that swings, as a rover that weaves about its track."""
    log = driven(proposal, tuned)
    t = log.t
    target = math.radians(12) * np.sin(2 * np.pi * hz * t)
    late = 0.2
    return replace(
        log,
        target=target,
        actual=math.radians(12) * np.sin(2 * np.pi * hz * (t - late)),
        ff=tuned.ff * target,
        p=0 * t,
        i=0 * t,
        parameters={**log.parameters, **known},
        mode=np.full(t.size, mode),
    )


@pytest.mark.parametrize(
    ("mode", "hz", "known", "parameter", "value", "loop"),
    [
        (AUTO, 0.2, POSITION, "PSC_VEL_P", 0.5, "the position controller"),
        (AUTO, 0.2, {"PSC_POS_P": 1.3, "PSC_VEL_P": 6.0}, "PSC_POS_P", 0.65, "the position controller"),
        (AUTO, 0.2, {"NAVL1_PERIOD": 8.0}, "NAVL1_PERIOD", 12.0, "the L1 controller"),
        (LOITER, 0.4, {"ATC_STR_ANG_P": 2.0, **POSITION}, "ATC_STR_ANG_P", 1.0, "the heading controller"),
    ],
)
def test_a_target_that_swings_names_the_loop_above(
    proposal: Proposal, tuned: Gains, mode, hz, known, parameter, value, loop
):
    check = check_steering(swinging(proposal, tuned, mode, hz, **known))
    fault = next(f for f in check.findings if f.name == "target swings")
    assert (fault.parameter, fault.value) == (parameter, pytest.approx(value))
    assert loop in fault.words and f"{hz:.2g} Hz" in fault.words
    said = [part.text for part in check_report(((), ()), ([check], ())).answer]
    assert not said[0].startswith("Nothing to change")


def test_a_pilot_may_swing_and_a_mission_may_turn(proposal: Proposal, tuned: Gains):
    """The stick's sine in ACRO is meant; a square of 12 m is driven round one way."""
    pilot = check_steering(swinging(proposal, tuned, ACRO, **POSITION))
    assert not [f for f in pilot.findings if f.name == "target swings"]
    log = swinging(proposal, tuned, AUTO, **POSITION)
    corner = np.where(log.t % 6.7 < 1.5, math.radians(60), 0.0)
    square = replace(log, target=corner, actual=np.interp(log.t - 0.2, log.t, corner))
    mission = check_steering(square)
    assert not [f for f in mission.findings if f.name == "target swings"]
    unknown = check_steering(replace(swinging(proposal, tuned, AUTO, **POSITION), mode=np.empty(0)))
    assert not [f for f in unknown.findings if f.name == "target swings"]


def test_the_mode_is_read_from_the_log():
    """The recorded drives are in ACRO."""
    for path in (RECORDED / "check.BIN", RECORDED / "half.tlog"):
        log = read_controllers(path).steering[0]
        assert log.mode.size in (0, log.t.size)
        assert set(log.mode) <= {ACRO}
