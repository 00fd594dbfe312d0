"""Nothing goes out before the limits and the stick were looked at: one override alone lasts 100 ms."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from applet_bench import HIGH, Bench, Drive, happen, moving, mutant, throw_switch, thrown

from firmware_params.applet_parameters import applet_source
from rover_sweep.manoeuvre.multisine import Multisine

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
