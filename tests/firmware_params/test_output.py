"""What goes out: within the servo's limits whatever the wave says, and never after a pause of the script."""

from __future__ import annotations

import pytest
from applet_bench import KINDS, Bench, Drive, moving, mutant, throw_switch

from firmware_params.applet_parameters import applet_source

FIVEFOLD = ("return state, envelope * offset", "return state, 5.0 * envelope * offset")
NO_LIMIT = ("math.max(run.low, math.min(run.high, pwm))", "pwm")
NO_PAUSE = ("not (paused <= OVERRIDE_MS)", "false")


def sent(source: str, kind: str = "sweep", **servo: int) -> set[int]:
    """PWM of all overrides of a run of 100 us on a servo with these SERVO1_ parameters."""
    bench = moving(**{"amp": 100, "straight": 1, "fade": 0, "dwell": 0, "trec": 5, "still": 0} | KINDS[kind])
    bench.parameters |= {f"SERVO1_{name.upper()}": value for name, value in servo.items()}
    drive = Drive(bench, source)
    throw_switch(drive)
    drive.run(10)
    assert drive.host.error is None
    return {pwm for _, pwm, timeout, _ in bench.overrides if timeout}


def test_no_output_leaves_the_range_of_the_servo() -> None:
    """The firmware does not hold a script's override within SERVO1_MIN..MAX."""
    servo = {"min": 1390, "max": 1605}
    assert min(sent(applet_source(), **servo)) == 1400 and max(sent(applet_source(), **servo)) == 1600
    wrong_wave = sent(mutant(FIVEFOLD), **servo)
    assert min(wrong_wave) == 1390 and max(wrong_wave) == 1605
    without = sent(mutant(FIVEFOLD, NO_LIMIT), **servo)
    assert min(without) < 1390 or max(without) > 1605


@pytest.mark.parametrize("kind", ["sweep", "multisine", "bias sweep"])
def test_no_output_is_further_from_trim_than_allowed(kind: str) -> None:
    wrong_wave = sent(mutant(FIVEFOLD), kind)
    assert min(wrong_wave) == (1500 if kind == "bias sweep" else 1250) and max(wrong_wave) == 1750
    without = sent(mutant(FIVEFOLD, NO_LIMIT), kind)
    assert max(without) > 1750 or min(without) < 1250


def paused_in_a_run(seconds: float, source: str, kind: str = "sweep") -> Bench:
    bench = moving(trec=20, still=0, **KINDS[kind])
    drive = Drive(bench, source)
    throw_switch(drive)
    drive.run_until(6)
    bench.pilot_pwm = 1444
    drive.pause(seconds)
    drive.run(0.5)
    return bench


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seconds", [0.101, 0.454, 5.0])
def test_pause_in_which_the_override_ran_out_ends_the_run(seconds: float, kind: str) -> None:
    bench = paused_in_a_run(seconds, applet_source(), kind)
    assert bench.texts[-1] == f"SWP: run 1 stopped: script paused {1000 * seconds:.0f} ms"
    assert bench.state == 10 and bench.overrides[-1][2] == 0 and bench.servo_pwm(0) == 1444
    assert paused_in_a_run(seconds, mutant(NO_PAUSE), kind).state == 6


@pytest.mark.parametrize("seconds", [0.072, 0.099])
def test_pause_that_the_override_outlasts_does_not(seconds: float) -> None:
    assert paused_in_a_run(seconds, applet_source()).state == 6


def test_pause_before_the_override_ends_nothing() -> None:
    bench = moving(speed=0.0)
    drive = Drive(bench)
    throw_switch(drive)
    drive.pause(2.0)
    bench.velocity = (2.0, 0.0, 0.0)
    drive.run(3)
    assert bench.state == 3
    drive.run(1)
    assert "stopped" not in bench.said


def let_go(channel: int | None, source: str) -> tuple[int, int]:
    """(PWM, timeout) of the last override after another output (None: none) took over steering at 0 us."""
    bench = moving(straight=0, fade=0, trec=20, still=0)
    drive = Drive(bench, source)
    throw_switch(drive)
    drive.run(0.5)
    bench.steering_channel, bench.forced_output = channel, 0
    drive.run(0.09)
    assert bench.state == 10 and drive.host.running
    return bench.overrides[-1][1:3]


@pytest.mark.parametrize("channel", [None, 1])
def test_servo_that_steers_no_more_is_left_at_trim(channel: int | None) -> None:
    """An output without a function keeps what it was last given; the new one's PWM is none of its own."""
    assert let_go(channel, applet_source()) == (1500, 0)


def test_servo_that_steers_no_more_would_get_the_pwm_of_the_other() -> None:
    look = ("if SRV_Channels:find_channel(servo) ~= channel then", "if false then")
    assert let_go(1, mutant(look)) == (0, 0)
