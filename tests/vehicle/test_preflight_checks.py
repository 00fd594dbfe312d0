"""What the checks before a run say of what was seen: pure, without a vehicle."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest

from firmware_params.applet_parameters import PARAMETERS, applet_version
from firmware_params.param_files import read, shipped
from rover_sweep.vehicle.identity import VehicleIdentity
from rover_sweep.vehicle.link.inbox import LinkQuality
from rover_sweep.vehicle.link.streams import IDENTIFICATION_RATES, Stream, StreamQuality
from rover_sweep.vehicle.preflight.read_rover import (
    Battery,
    Check,
    ClockComparison,
    Estimator,
    Gps,
    Observation,
    Prearm,
    estimate,
)
from rover_sweep.vehicle.preflight.readiness import NAMES, all_checks
from rover_sweep.vehicle.setup import AppletFile, AppletState, Survey, SurveyedParameter

WANTED = read(shipped("identification"))
HAS = (
    {p.name: p.value for p in WANTED}
    | {p.name: float(p.default) for p in PARAMETERS}
    | {"STAT_BOOTCNT": 3.0, "FS_THR_ENABLE": 1.0, "FS_THR_VALUE": 910.0, "FS_ACTION": 2.0}
    | {"RC1_TRIM": 1500.0, "RC3_TRIM": 1500.0, "BATT_LOW_VOLT": 10.5, "LOG_BITMASK": 65535.0}
    | {"LOG_BACKEND_TYPE": 1.0, "LOG_DISARMED": 0.0, "SWP_VER": applet_version(), "RC_OVERRIDE_TIME": 3.0}
    | {"MODE_CH": 8.0, "ARMING_CHECK": 1.0}
)


# Checks that look at a part of what another one looks at.
SAME_NUMBERS = {"parameters", "loop_rate", "filters", "streams", "source", "switch", "rc_options"}


def survey_of(has: dict[str, float]) -> Survey:
    applet = AppletState(
        AppletFile("scripts/rover_sweep.lua", "1.2", ""), (), has["SWP_ENABLE"] == 1, True, applet_version()
    )
    vehicle = VehicleIdentity("ArduRover 4.6.3", (4, 6, 3), "3fc7011a", 42, 1)
    return Survey(vehicle, tuple(SurveyedParameter(p, has.get(p.name)) for p in WANTED), applet)


def seen(changed: dict[str, float] | None = None, **values: Any) -> Observation:
    """A rover with which all is well, but for what is given."""
    has = HAS | (changed or {})
    fast = {name: hz for name, hz in IDENTIFICATION_RATES.items() if hz >= 10}
    whole = Observation(
        survey_of(has),
        has,
        25.0,
        False,
        0,
        tuple(Stream(name, hz, hz) for name, hz in IDENTIFICATION_RATES.items()),
        tuple(StreamQuality(name, int(2 * hz), hz, 1.0, 1300 / hz, 0.0, hz) for name, hz in fast.items()),
        ClockComparison(2.0, 1.0, 0.004, 1e-5, 1e-3, 0.2),
        Battery(12.4, 0.9),
        Gps(3, 10, 0.8),
        Estimator(831, 0.1),
        {n: 1000 if n == 6 else 1500 for n in range(1, 9)},
        True,
        disk=(20_000_000_000, "today"),
        link=LinkQuality(5.0, 900, latency=0.04),
        prearm=Prearm(True),
    )
    return replace(whole, **values)


def check(name: str, what: Observation) -> Check:
    return next(c for c in all_checks(what) if c.name == name)


def failing(*reasons: str) -> Prearm:
    return Prearm(False, reasons=reasons)


def worse(**changed: float) -> tuple[StreamQuality, ...]:
    return tuple(replace(q, **changed) for q in seen().quality)


def test_where_all_is_well_all_checks_say_so() -> None:
    checks = all_checks(seen())
    assert tuple(c.name for c in checks) == NAMES
    assert [c.name for c in checks if c.state != "good" or c.remedy] == []


@pytest.mark.parametrize(
    ("name", "state", "said", "what"),
    [
        ("parameters", "bad", "SCHED_LOOP_RATE is 50, wanted at least 100", seen({"SCHED_LOOP_RATE": 50.0})),
        ("parameters", "bad", "was set and takes effect after a reboot", seen(pending=("SCR_ENABLE",))),
        ("applet", "bad", "SWP_ENABLE is 0", seen({"SWP_ENABLE": 0.0})),
        ("loop_rate", "bad", "streams are limited to 40 Hz", seen({"SCHED_LOOP_RATE": 50.0})),
        ("loop_rate", "bad", "samples a period at 50 Hz, and", seen({"SCHED_LOOP_RATE": 50.0}, w_max=60.0)),
        ("filters", "bad", "INS_GYRO_FILTER 4 Hz: 56 ms of lag", seen({"INS_GYRO_FILTER": 4.0})),
        ("filters", "doubtful", "lets vibration through", seen({"INS_ACCEL_FILTER": 0.0})),
        ("streams", "doubtful", "25.0 times a second instead of 50", seen(quality=worse(mean_hz=25.0))),
        ("streams", "doubtful", "longest gap 90 ms", seen(quality=worse(gap_ms=90.0, mean_hz=50.0))),
        (
            "streams",
            "doubtful",
            "did not arrive, although the vehicle granted it",
            seen(quality=worse(count=0)),
        ),
        (
            "clock",
            "doubtful",
            "messages arrive up to 90 ms late",
            seen(clock=ClockComparison(2, 1, 0.09, 0, 1)),
        ),
        ("clock", "bad", "messages arrive up to 300 ms late", seen(clock=ClockComparison(2, 1, 0.3, 0, 1))),
        ("clock", "good", "a simulation", seen(clock=ClockComparison(2, 5.0, 0.3, 0.8, 0.1))),
        (
            "clock",
            "good",
            "this computer is -48 h from GPS time",
            seen(clock=ClockComparison(2, 1, 0, 0, 1, -172800)),
        ),
        ("clock", "unknown", "too few messages", seen(clock=None)),
        ("logging", "bad", "the log will have no IMU at loop rate", seen({"LOG_BITMASK": 65407.0})),
        ("logging", "bad", "writes no files", seen({"LOG_BACKEND_TYPE": 2.0})),
        ("logging", "bad", "is a card in it", seen(logging=False)),
        ("disk", "bad", "room for 2 runs", seen(disk=(9_000_000, "today"))),
        ("battery", "bad", "at or below BATT_LOW_VOLT 10.5 V", seen(battery=Battery(10.4, 0.5))),
        ("battery", "doubtful", "BATT_WATT_MAX 200 W lowers the throttle", seen({"BATT_WATT_MAX": 200.0})),
        ("parameters", "good", "MOT_REV_DELAY 0.3 s: the motor pauses", seen({"MOT_REV_DELAY": 0.3})),
        ("gps", "bad", "no speed", seen(gps=Gps(2, 4))),
        ("ekf", "bad", "the EKF has no velocity and no position", seen(estimator=Estimator(1))),
        ("rc", "bad", "only this computer could stop the rover", seen(channels={})),
        ("rc", "bad", "the steering stick (channel 1) is +90 us", seen(channels={1: 1590, 3: 1500, 6: 1000})),
        ("rc", "bad", "does not hear its radio", seen(radio=False)),
        ("rc", "bad", "would not react to a loss of the radio", seen({"FS_THR_ENABLE": 0.0})),
        ("switch", "bad", "switch 6 is high", seen(channels={1: 1500, 3: 1500, 6: 1900})),
        ("switch", "bad", "none has option 300", seen({"RC6_OPTION": 0.0})),
        ("switch", "bad", "throwing it changes the mode", seen({"MODE_CH": 6.0})),
        (
            "rc_options",
            "bad",
            "RC6_OPTION and RC9_OPTION are 300: the autopilot",
            seen({"RC9_OPTION": 300.0}),
        ),
        ("rc_options", "bad", "(MODE_CH) and RC8_OPTION is 41", seen({"RC8_OPTION": 41.0})),
        (
            "rc_options",
            "doubtful",
            "are 300: one switch does two things",
            seen({"RC9_OPTION": 300.0, "ARMING_CHECK": 2.0}),
        ),
        ("prearm", "bad", "does not arm: Compass not healthy", seen(prearm=failing("Compass not healthy"))),
        ("prearm", "bad", "its reason did not arrive", seen(prearm=failing())),
        ("prearm", "doubtful", "now its checks pass", seen(prearm=Prearm(True, reasons=("Gyros",)))),
        ("prearm", "doubtful", "checks nothing before", seen(prearm=Prearm(False, off=True))),
        ("prearm", "unknown", "does not report", seen(prearm=None)),
        ("mode", "bad", "the rover is in HOLD", seen(mode=4)),
        ("applet", "doubtful", "SWP_V_MIN is 0, as for a test on a box", seen({"SWP_V_MIN": 0.0})),
        ("armed", "bad", "does not set it up or reboot it", seen(armed=True)),
    ],
)
def test_what_is_wrong_is_told_and_nothing_else(name: str, state: str, said: str, what: Observation) -> None:
    found = check(name, what)
    assert found.state == state and said in found.sentence
    assert (found.remedy is None) == (state in ("good", "unknown"))
    others = {c.name for c in all_checks(what) if c.state != "good"} - {name}
    assert others <= SAME_NUMBERS


def test_an_armed_rover_in_hold_is_taken_back_with_centred_sticks_and_the_mode_switch() -> None:
    """The mode switch is read only when it moves, and in MANUAL the sticks act at once."""
    back = "centre the sticks, then turn the mode switch to another position and back to MANUAL"
    held = {name: check(name, seen(mode=4, armed=True)).remedy for name in ("mode", "armed")}
    assert held["mode"] is not None and held["mode"].words == back and held["mode"].by_hand
    assert held["armed"] is not None and held["armed"].words == f"disarm; to drive it from HOLD: {back}"
    in_manual = check("armed", seen(armed=True)).remedy
    assert in_manual is not None and in_manual.words == "disarm"


def test_each_reason_of_the_autopilot_has_its_own_advice() -> None:
    reasons = failing("Hardware safety switch", "Compass not calibrated", "Compass not healthy", "Yoghurt")
    found = check("prearm", seen(prearm=reasons))
    assert found.seen == "4 not passed" and found.remedy is not None and found.remedy.by_hand
    press, compass, other = found.remedy.words.split("; ")
    assert (press, "calibrate the compass" in compass) == ("press the safety switch", True)
    assert "Pre-Arm Safety Checks" in other


def test_an_armed_rover_is_not_asked_for_its_checks_before_arming() -> None:
    found = check("prearm", seen(armed=True, prearm=None))
    assert (found.state, found.seen, found.remedy) == ("unknown", "not asked", None)


def test_the_reason_for_the_gyro_filter_has_the_figures_of_the_check() -> None:
    """The default of 4 Hz at the top of a 25 rad/s sweep, in preflight and in the file of parameters."""
    loss = check("filters", seen({"INS_GYRO_FILTER": 4.0})).sentence
    figures = re.search(r"(\d+ ms) of lag, (gain [.\d]+)", loss)
    (reason,) = [p.reason for p in WANTED if p.name == "INS_GYRO_FILTER"]
    assert figures is not None and all(figure in reason for figure in figures.groups()), (reason, loss)


def test_the_source_is_the_log_else_the_telemetry_and_says_why() -> None:
    good = check("source", seen())
    assert good.seen.startswith("the .BIN log") and "at 100 Hz on one clock" in good.sentence
    assert "without it the .tlog (50 Hz) is good enough" in good.sentence
    slow = check("source", seen(quality=worse(lost=0.1, mean_hz=45.0)))
    assert slow.state == "good" and "the .tlog (45 Hz) is not good enough to replace it" in slow.sentence
    unlogged = check("source", seen(logging=False))
    assert unlogged.state == "doubtful" and unlogged.seen == "the .tlog, 50 Hz"
    assert "is a card in it" in unlogged.sentence
    neither = check("source", seen(logging=False, quality=worse(lost=0.1, mean_hz=45.0)))
    assert neither.state == "bad" and "10% did not arrive" in neither.sentence


def test_a_capped_stream_names_the_loop_rate_that_would_do() -> None:
    denied = Stream("ATTITUDE", 50.0, 40.0, "ATTITUDE at 50 Hz is denied: SCHED_LOOP_RATE 50 allows 40 Hz")
    found = check("streams", seen(streams=(denied, *seen().streams[1:])))
    assert found.state == "doubtful" and found.remedy is not None
    assert found.remedy.sets == (("SCHED_LOOP_RATE", 100.0),) and found.remedy.reboot


def test_two_clocks_are_compared_whatever_the_radio_adds() -> None:
    """The vehicle's runs 200 ppm slow, and every third message is 30 ms late."""
    pairs = [(t := 0.02 * n, 1000.0 + t * 1.0002 + (0.03 if n % 3 == 0 else 0.0)) for n in range(3000)]
    found = estimate(pairs, 1.5)
    assert found is not None and found.span == pytest.approx(59.98)
    assert found.drift == pytest.approx(2e-4, abs=2e-5) and found.bound < 1e-4
    assert found.jitter == pytest.approx(0.03, abs=0.001) and found.offset == pytest.approx(1000.0, abs=1e-3)
    assert found.rate == pytest.approx(1, abs=0.001) and found.behind_utc == 1.5
    assert estimate(pairs[:10]) is None and estimate([(1.0, 1.0)] * 30) is None


@pytest.mark.parametrize(
    ("link", "state", "told"),
    [
        (LinkQuality(5.0, 900, latency=0.04), "good", "nothing lost, answers in 40 ms"),
        (LinkQuality(5.0, 900, 0.05, 0.04), "doubtful", "5.0% lost"),
        (LinkQuality(5.0, 900, 0.52), "bad", "52.0% lost"),
        (LinkQuality(5.0, 900, latency=4.0), "bad", "nothing lost, answers in 4000 ms"),
        (LinkQuality(2.0, 3, 0.5), "unknown", "not measured"),
    ],
)
def test_the_link(link: LinkQuality, state: str, told: str) -> None:
    found = check("link", seen(link=link))
    assert (found.state, found.seen) == (state, told)
    assert link.words.partition(";")[0] in found.sentence
    assert found.remedy is None or found.remedy.by_hand


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"SERVO1_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0}, "skid steering (SERVO1_FUNCTION is 73 and"),
        ({"FRAME_CLASS": 2.0}, "this is a boat (FRAME_CLASS is 2)"),
        ({"FRAME_CLASS": 3.0}, "this is a balance bot (FRAME_CLASS is 3)"),
    ],
)
def test_a_vehicle_without_steered_wheels_is_named(changed: dict[str, float], words: str) -> None:
    check = next(c for c in all_checks(seen(changed)) if c.name == "firmware")
    assert check.state == "bad" and words in check.sentence and "docs/questions.md" in check.sentence


@pytest.mark.parametrize("version", [(4, 6, 3), (4, 8, 0)])
def test_two_steering_outputs_are_a_warning_by_name(version: tuple[int, int, int]) -> None:
    rover = seen({"SERVO1_FUNCTION": 26.0, "SERVO4_FUNCTION": 26.0})
    vehicle = replace(rover.survey.vehicle, version=version)
    observed = replace(rover, survey=replace(rover.survey, vehicle=vehicle))
    check = next(c for c in all_checks(observed) if c.name == "firmware")
    assert (check.state, check.seen) == ("doubtful", "2 outputs steer")
    assert "four-wheel steering: the applet sweeps SERVO1 alone, and SERVO4 stays" in check.sentence
    assert ("is newer than 4.6" in check.sentence) == (version == (4, 8, 0))
    assert check.remedy is not None and check.remedy.by_hand and "lumped model" in check.remedy.words


def test_thrust_outputs_with_a_steering_output_are_accepted() -> None:
    changed = {"SERVO1_FUNCTION": 26.0, "SERVO2_FUNCTION": 73.0, "SERVO3_FUNCTION": 74.0}
    check = next(c for c in all_checks(seen(changed)) if c.name == "firmware")
    assert check.state == "good"
