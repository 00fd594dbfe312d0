"""What makes no sense, or is not there, is refused in words; nothing starts and the script lives on."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from applet_bench import HIGH, LOW, Bench, Drive, happen, moving, mutant, throw_switch, thrown

from firmware_params.applet_parameters import applet_source
from rover_sweep.manoeuvre.multisine import Multisine


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ({"SWP_ENABLE": 0}, "SWP_ENABLE is 0"),
        ({"SWP_ENABLE": float("nan")}, "SWP_ENABLE is nan"),
        ({"SWP_AMP": 260}, "SWP_AMP 260 > SWP_PWM_MAX 250"),
        ({"SWP_AMP": 0}, "SWP_AMP 0 outside 1 to 500"),
        ({"SWP_AMP": float("nan")}, "SWP_AMP nan outside 1 to 500"),
        ({"SWP_WMIN": 25}, "SWP_WMIN 25 >= SWP_WMAX 25"),
        ({"SWP_WMIN": -1}, "SWP_WMIN -1 outside 0.05 to 50"),
        ({"SWP_TREC": 0}, "SWP_TREC 0 outside 1 to 600"),
        ({"SWP_FADE": -2}, "SWP_FADE -2 outside 0 to 20"),
        ({"SWP_TYPE": 5}, "SWP_TYPE 5 outside 0 to 4"),
        ({"SWP_TYPE": 0.5}, "SWP_TYPE 0.5 is unknown"),
        ({"SWP_V_MIN": 4}, "SWP_V_MIN 4 >= SWP_V_MAX 4"),
        ({"SWP_TYPE": 2.5}, "SWP_TYPE 2.5 is unknown"),
        ({"SWP_BIAS": 450}, "SWP_BIAS 450 outside -400 to 400"),
        ({"SWP_TYPE": 3, "SWP_BIAS": float("nan")}, "SWP_BIAS nan outside -400 to 400"),
        ({"SWP_TYPE": 3, "SWP_BIAS": 101}, "AMP + BIAS 251 > SWP_PWM_MAX 250"),
        ({"SWP_TYPE": 3, "SWP_BIAS": -101}, "AMP + BIAS 251 > SWP_PWM_MAX 250"),
        ({"SWP_TYPE": 3, "SWP_BIAS": 90, "SERVO1_MAX": 1739}, "PWM 1590+-150 not in 1100..1739"),
        ({"SWP_TYPE": 3, "SWP_BIAS": -90, "SERVO1_MIN": 1261}, "PWM 1410+-150 not in 1261..1900"),
        (
            {"SWP_TYPE": 3, "SWP_BIAS": 80, "SWP_AMP": 30, "SERVO1_MIN": 1510},
            "PWM 1580+-30 not in 1510..1900",
        ),
        (
            {"SWP_TYPE": 3, "SWP_BIAS": -80, "SWP_AMP": 30, "SERVO1_MAX": 1490},
            "PWM 1420+-30 not in 1100..1490",
        ),
        ({"SWP_TYPE": 2, "SWP_COUNT": 1}, "SWP_COUNT 1 is not 2, 3.."),
        ({"SWP_TYPE": 2, "SWP_COUNT": 2.5}, "SWP_COUNT 2.5 is not 2, 3.."),
        ({"SWP_TYPE": 2, "SWP_TREC": 2}, "2 odd lines, not 4 to 128"),
        ({"SWP_TYPE": 2, "SWP_TREC": 1, "SWP_WMAX": 1}, "0 odd lines, not 4 to 128"),
        ({"SWP_TYPE": 2, "SWP_TREC": 600}, "590 odd lines, not 4 to 128"),
        ({"SWP_TYPE": 2, "SWP_AMP": 251}, "SWP_AMP 251 > SWP_PWM_MAX 250"),
        ({"SERVO1_MAX": 1640}, "PWM 1500+-150 not in 1100..1640"),
        ({"SERVO1_MIN": 1360}, "PWM 1500+-150 not in 1360..1900"),
        ({"RCMAP_ROLL": 0}, "RCMAP_ROLL outside 1 to 16"),
        ({"RCMAP_ROLL": 17}, "RCMAP_ROLL outside 1 to 16"),
        ({"steering_channel": None}, "no servo has function 26 (steering)"),
        ({"SERVO1_TRIM": None}, "SERVO1_TRIM, MIN, MAX unknown"),
        ({"current_mode": 10}, "mode 10, needs MANUAL"),
        ({"is_rc_valid": False}, "no RC"),
        ({"velocity": None}, "no velocity estimate"),
    ],
)
def test_refused_at_the_switch(spoil: dict[str, Any], said: str) -> None:
    bench = moving()
    drive = Drive(bench)
    happen(bench, spoil)
    throw_switch(drive)
    drive.run(3)
    assert bench.texts[1:] == [f"SWP: refused: {said}"]
    assert bench.overrides == [] and bench.log == [] and bench.parameters["SWP_RUN"] == 0
    assert drive.host.running


@pytest.mark.parametrize("bias", [101, -101])
def test_bias_counts_for_the_steering_limit_by_its_own_line(bias: float) -> None:
    bench = moving(type=3, bias=bias, still=0)
    throw_switch(
        Drive(bench, mutant(("elseif v.AMP + math.abs(middle(v)) > v.PWM_MAX then", "elseif false then")))
    )
    assert bench.state == 3


def test_bias_counts_for_the_range_of_the_servo_by_its_own_line() -> None:
    def started(source: str) -> bool:
        bench = moving(type=3, bias=90, still=0)
        bench.parameters["SERVO1_MAX"] = 1739
        thrown(bench, source)
        return bench.state == 3

    assert not started(applet_source())
    assert started(mutant(("local centre = trim + middle(v)", "local centre = trim")))


def test_refused_run_starts_once_put_right_and_thrown_again() -> None:
    bench = moving(trec=0)
    drive = thrown(bench)
    bench.parameters["SWP_TREC"] = 5
    drive.run(2)
    assert bench.state == 0
    throw_switch(drive)
    assert bench.state == 3


INFINITE, UNKNOWN = float("inf"), float("nan")


@pytest.mark.parametrize("channel", [17, -1, 300, 16.5, 1e20, -1e20, INFINITE, -INFINITE, UNKNOWN])
def test_impossible_switch_channel_is_said_and_does_not_kill_the_script(channel: float) -> None:
    bench = moving(chan=channel)
    drive = thrown(bench)
    assert bench.texts[1:] == [f"SWP: refused: SWP_CHAN {channel:g} outside 0 to 16"]
    assert drive.host.running and bench.state == 0
    bench.parameters["SWP_CHAN"] = 0
    throw_switch(drive)
    assert bench.state == 3


@pytest.mark.parametrize("channel", [17, 1e20, UNKNOWN])
def test_impossible_switch_channel_kills_a_script_that_does_not_look(channel: float) -> None:
    check = "value >= 0 and value <= 16 and math.floor(value) or nil"
    assert applet_source().count(check) == 1
    bench = moving(chan=channel)
    drive = thrown(bench, applet_source().replace(check, "math.floor(value)"))
    assert not drive.host.running and drive.host.error


NEEDED = (
    "SRV_Channels:set_output_pwm_chan_timeout",
    "SRV_Channels:find_channel",
    "SRV_Channels",
    "rc:get_aux_cached",
    "rc:has_valid_input",
    "arming:is_armed",
    "vehicle:get_mode",
    "ahrs:get_gyro",
    "ahrs:get_roll",
    "logger:write",
    "param:add_table",
)


@pytest.mark.parametrize("missing", NEEDED)
def test_call_that_is_needed_is_missed_in_words(missing: str) -> None:
    bench = moving()
    drive = Drive(bench, removed=(missing,))
    assert len(bench.texts) == 1 and bench.texts[0].startswith(f"SWP: no {missing}")
    assert not drive.host.running and drive.host.error is None


@pytest.mark.parametrize("removed", ["SRV_Channels:get_output_pwm_chan", "SRV_Channels:get_output_pwm"])
def test_either_way_to_read_the_output_will_do(removed: str) -> None:
    """4.5.7 has no get_output_pwm_chan."""
    bench = moving(still=0, trec=5, straight=0)
    drive = thrown(bench, removed=(removed,))
    drive.run_until(0)
    assert bench.texts[-1] == "SWP: run 1 done" and max(row["Out"] for row in bench.log) == 1650


def test_neither_way_to_read_the_output_is_refused() -> None:
    bench = moving()
    Drive(bench, removed=("SRV_Channels:get_output_pwm_chan", "SRV_Channels:get_output_pwm"))
    assert bench.texts == ["SWP: no SRV_Channels:get_output_pwm"]


def test_roll_is_read_by_its_new_name_where_there_is_one() -> None:
    """4.7 and later refuse to arm after a single call of ahrs:get_roll."""
    newer = "ahrs.get_roll_rad, ahrs.get_roll = ahrs.get_roll, function() error('deprecated') end\n"
    bench = moving(still=0, trec=5, straight=0)
    drive = thrown(bench, newer + applet_source())
    drive.run_until(0)
    assert drive.host.error is None and bench.texts[-1] == "SWP: run 1 done"


def test_gcs_loss_wanted_but_not_to_be_seen_is_refused() -> None:
    bench = moving(gcs=1)
    drive = thrown(bench, removed=("gcs:last_seen",))
    assert bench.texts[-1] == "SWP: refused: SWP_GCS 1, but no gcs:last_seen"
    bench.parameters["SWP_GCS"], bench.switch = 0, LOW
    throw_switch(drive)
    assert bench.state == 3


def test_parameter_table_of_another_script_is_not_touched() -> None:
    class Full(Bench):
        def add_parameter(self, name: str, default: float) -> bool:
            return name != "SWP_TREC"

    bench = Full()
    bench.parameters |= dict.fromkeys(("SWP_ENABLE", "SWP_TYPE", "SWP_AMP", "SWP_WMIN", "SWP_WMAX"), 1.0)
    drive = Drive(bench)
    assert bench.texts == ["SWP: refused: cannot add SWP_TREC"] and not drive.host.running


def test_switch_that_was_never_set_is_not_low() -> None:
    bench = moving()
    bench.switch = None
    drive = Drive(bench)
    drive.run(1)
    bench.switch = 2
    drive.run(1)
    assert bench.state == 0 and not bench.overrides


# ---- Nothing goes out before the limits and the stick were looked at: one override alone lasts 100 ms.

AT_ONCE = {"type": 1, "straight": 0, "amp": 240, "still": 0}  # the first override is a full step
BIAS_AT_ONCE = {"type": 3, "straight": 0, "fade": 0, "amp": 100, "bias": 140, "still": 0}
START_CHECK = ("    local reason = limit_passed(run, seen)\n", "    local reason = nil\n")
SWITCH_CHECK = (" or reason_to_stop(values, seen)", "")
CENTRED_CHECK = ("stick_off(run) <= STICK_CENTRED_US", "true")


Changes = dict[str, Any]
LIMITS = (
    ({"roll": math.radians(60)}, "roll 60.0 > 30 deg"),
    ({"rates": (4.0, 0.0, 0.0)}, "roll rate 229.2 > 200 deg/s"),
    ({"rates": (0.0, 0.0, 10.0)}, "yaw rate 573.0 > 150 deg/s"),
)


def thrown_while_moving(spoil: Changes, source: str) -> Bench:
    bench = moving(**AT_ONCE)
    happen(bench, spoil)
    thrown(bench, source)
    return bench


def brought_to_speed(spoil: Changes, source: str) -> Bench:
    bench = moving(speed=0.0, **AT_ONCE)
    drive = thrown(bench, source, seconds=1)
    happen(bench, spoil)
    bench.velocity = (2.0, 0.0, 0.0)
    drive.run(1.2)
    return bench


def bias_while_moving(spoil: Changes, source: str) -> Bench:
    bench = moving(**BIAS_AT_ONCE)
    happen(bench, spoil)
    thrown(bench, source)
    return bench


def multisine_while_moving(spoil: Changes, source: str) -> Bench:
    """It waits in state 2 for a second in the band, and for its peak."""
    bench = moving(type=2, straight=0, fade=0, count=3, still=0)
    drive = thrown(bench, source, seconds=0.5)
    happen(bench, spoil)
    drive.run(0.6)
    return bench


FIRST_PWM = {
    thrown_while_moving: {1740},
    brought_to_speed: {1740},
    bias_while_moving: {1640},
    multisine_while_moving: {round(1500 + float(Multisine(straight=0, fade=0).wave(0.0)))},
}


@pytest.mark.parametrize("course", FIRST_PWM)
@pytest.mark.parametrize(("spoil", "said"), LIMITS)
def test_limit_that_is_passed_already(
    course: Callable[[Changes, str], Bench], spoil: Changes, said: str
) -> None:
    bench = course(spoil, applet_source())
    assert bench.state == 10 and bench.texts[-1] == f"SWP: run 1 stopped: {said}"
    assert bench.overrides == [] and bench.log[-1]["St"] == 10
    assert {pwm for _, pwm, hold, _ in course(spoil, mutant(START_CHECK)).overrides if hold} == FIRST_PWM[
        course
    ]


def lost_before_the_switch(source: str) -> Bench:
    bench = moving(gcs=1, **AT_ONCE)
    bench.heard_ms = 1000
    thrown(bench, source)
    return bench


def test_ground_station_that_was_lost_before_the_switch() -> None:
    bench = lost_before_the_switch(applet_source())
    assert bench.texts[1:] == ["SWP: refused: GCS lost"] and bench.overrides == [] and bench.state == 0
    assert lost_before_the_switch(mutant(SWITCH_CHECK)).overrides[0][1] == 1740


def held_at(stick: int, source: str) -> Drive:
    bench = moving(**AT_ONCE)
    bench.rc[1] = stick
    drive = thrown(bench, source, seconds=3)
    return drive


@pytest.mark.parametrize("stick", [1620, 1100, 1900, 0])
def test_stick_off_centre_is_waited_for_and_counts_from_then_on(stick: int) -> None:
    drive = held_at(stick, applet_source())
    bench = drive.bench
    assert bench.state == 2 and bench.overrides == []
    assert bench.texts[1:] == [
        "SWP: run 1 waits for a centred steering stick",
        "SWP: run 1 drive at 0.5 to 4 m/s",
    ]
    bench.rc[1] = 1500
    drive.run(0.9)
    assert bench.state == 2
    drive.run(0.3)
    assert bench.state == 6 and bench.overrides
    bench.rc[1] = 1290
    drive.run(0.09)
    assert bench.texts[-1] == "SWP: run 1 stopped: steering stick moved"


def test_stick_off_centre_steers_against_a_run_that_does_not_wait() -> None:
    assert held_at(1620, mutant(CENTRED_CHECK)).bench.overrides


@pytest.mark.parametrize("stick", [1400, 1600])
def test_stick_nearly_centred_will_do(stick: int) -> None:
    drive = held_at(stick, applet_source())
    assert drive.bench.state == 6 and drive.bench.switch == HIGH


def test_pwm_that_the_pilot_gave_is_no_reason_not_to_start() -> None:
    bench = moving(amp=20, pwm_max=40, still=0)
    bench.pilot_pwm = 1590
    throw_switch(drive := Drive(bench))
    drive.run(1)
    assert bench.state == 3 and bench.texts[-1] == "SWP: run 1 start sweep"
