"""The wave that the applet puts on the servo is the closed form, whatever the update intervals."""

from __future__ import annotations

import re

import numpy as np
import pytest
from applet_bench import HIGH, KINDS, TRIM, Bench, Drive, moving, mutant, thrown

from firmware_params.applet_parameters import applet_source, for_manoeuvre
from rover_sweep.manoeuvre.multisine import LEFT_OUT, Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Manoeuvre, Sweep

UINT32 = 2**32


def driven(manoeuvre: Manoeuvre, start_us: int = 5_000_000) -> Bench:
    """A bench on which the whole manoeuvre was driven, without standstills."""
    bench = moving()
    bench.now = start_us
    bench.parameters |= for_manoeuvre(still=0, pwm_max=400, **vars(manoeuvre))
    drive = thrown(bench)
    drive.run_until(0)
    return bench


@pytest.mark.parametrize(
    "manoeuvre",
    [
        Sweep(),
        Sweep(amplitude=240, w_min=0.5, w_max=12, t_rec=20, fade=1, dwell=0, straight=1),
        Sweep(amplitude=90, w_min=2, w_max=60, t_rec=15, fade=0, dwell=3, straight=0),
        Doublet(),
        Doublet(amplitude=300, pulse=0.4, pause=0, count=3, straight=0.5),
        Multisine(),
        Multisine(amplitude=240, w_min=1, w_max=40, t_rec=20, periods=5, fade=1, dwell=0, straight=0),
        Multisine(amplitude=80, w_min=2.5, w_max=12, t_rec=12, periods=2, fade=0, dwell=3, straight=1),
        BiasSweep(bias=120),
        BiasSweep(amplitude=90, t_rec=12, fade=0, dwell=0, straight=0, bias=-150),
    ],
    ids=repr,
)
def test_wave_is_the_closed_form(manoeuvre: Manoeuvre) -> None:
    bench = driven(manoeuvre)
    steered = [row for row in bench.log if row["St"] >= 3]  # a multisine waits for its peak first
    t, wanted, on_servo = (np.array([row[name] for row in steered]) for name in ("T", "Cmd", "Out"))
    wanted, on_servo = wanted - TRIM, on_servo - TRIM
    np.testing.assert_allclose(wanted, manoeuvre.wave(t), atol=2e-3)
    np.testing.assert_allclose(on_servo, manoeuvre.wave(t), atol=0.502)  # a whole microsecond
    assert t[0] == 0 and manoeuvre.duration - 0.08 < t[-1] < manoeuvre.duration
    assert np.ptp(on_servo) > 1.8 * manoeuvre.amplitude and abs(on_servo).max() > 0.9 * manoeuvre.peak


def test_clock_of_the_wave_is_the_vehicles_and_survives_the_wrap_of_micros() -> None:
    sweep = Sweep(t_rec=10, straight=1)
    bench = driven(sweep, start_us=UINT32 - 6_000_000)
    t = np.array([row["T"] for row in bench.log])
    true = np.array([row["t"] for row in bench.log])
    assert bench.now > UINT32
    np.testing.assert_allclose(t, true - true[0], atol=2e-6)


def test_states_begin_and_end_where_the_manoeuvre_says() -> None:
    sweep = Sweep(t_rec=8, fade=1.5, dwell=2, straight=1)
    bench = driven(sweep)
    edges = np.cumsum([sweep.straight, sweep.fade, sweep.dwell, sweep.t_rec, sweep.fade])
    t = np.array([row["T"] for row in bench.log])
    expected = 3 + np.searchsorted(edges, t, side="right")
    np.testing.assert_array_equal([row["St"] for row in bench.log], expected)


def test_lines_left_out_are_those_of_the_closed_form() -> None:
    table = re.search(r"local LEFT_OUT = \{ (.*?) \}", applet_source())
    assert table and tuple(int(x) for x in table[1].split(",")) == LEFT_OUT


def test_multisine_waits_for_its_peak_and_steers_nothing_meanwhile() -> None:
    """The search over 126 odd lines takes longer than the second in the band."""
    manoeuvre = Multisine(t_rec=60, periods=2, w_max=53)
    assert manoeuvre.odd.size == 126
    bench = moving(still=0, **{k[4:].lower(): v for k, v in for_manoeuvre(**vars(manoeuvre)).items()})
    drive = thrown(bench, seconds=1.2)
    assert bench.state == 2 and not bench.overrides
    drive.run_until(3)
    assert 5 < len({row["t"] for row in bench.log if row["St"] == 2}) * 0.0135 < 20 and drive.host.running


def test_bias_means_nothing_to_the_other_types() -> None:
    bench = moving(still=0, straight=0, fade=0, dwell=0, trec=5, bias=240, amp=100)
    drive = thrown(bench)
    drive.run_until(0)
    assert bench.texts[-1] == "SWP: run 1 done"
    assert max(row["Out"] for row in bench.log) == 1600 and min(row["Out"] for row in bench.log) == 1400


def test_whole_course_with_standstills() -> None:
    bench = moving(speed=0.0, still=2, trec=5, straight=1)
    drive = thrown(bench, seconds=3)
    assert bench.state == 2 and not bench.overrides
    bench.velocity = (2.0, 0.0, 0.0)
    drive.run(0.9)
    assert bench.state == 2
    drive.run_until(9)
    steered = [row for row in bench.log if 3 <= row["St"] <= 8]
    assert len(steered) == len([o for o in bench.overrides if o[2] > 0])
    bench.velocity, bench.pilot_pwm = (0.1, 0.0, 0.0), 1620
    drive.run_until(0)
    course = [row["St"] for row in bench.log]
    assert sorted(set(course)) == [1, 2, 3, 4, 5, 6, 7, 8, 9] and course == sorted(course)
    assert bench.log[-1]["Out"] == 1620 and len(bench.overrides) == len(steered) + 1
    assert [text.removeprefix("SWP: run 1 ") for text in bench.texts[1:]] == [
        "stand still for 2 s",
        "drive at 0.5 to 4 m/s",
        "start sweep",
        "steering is yours: stop",
        "done",
    ]


def test_last_state_ends_after_30_s_without_standstill() -> None:
    bench = moving(type=1, count=1, still=2)
    drive = thrown(bench)
    assert "SWP: run 1 moving: no standstill in the record" in bench.texts
    drive.run_until(9)
    drive.run(29)
    assert bench.state == 9
    drive.run(1.5)
    assert bench.state == 0 and bench.texts[-2:] == ["SWP: run 1 no standstill at the end", "SWP: run 1 done"]


def test_leaving_the_standstill_early_is_said() -> None:
    bench = moving(speed=0.0, still=5)
    drive = thrown(bench, seconds=1)
    bench.velocity = (0.45, 0.0, 0.0)
    drive.run(0.1)
    assert bench.state == 2 and "SWP: run 1 standstill only 1." in bench.said


def test_runs_are_counted_over_a_reboot_and_told_with_state_and_frequency() -> None:
    bench = moving(still=0, trec=5, straight=0, fade=1, dwell=1)
    for number in (1, 2):
        drive = thrown(bench)
        drive.run_until(0)
        assert bench.parameters["SWP_RUN"] == number and bench.log[-1]["Run"] == number
        bench.switch = 0
    during = [(t, value) for t, name, value in bench.floats if name == "SWP_W" and value > 0]
    gaps = np.diff([t for t, _ in during]) * 1e-6
    assert np.median(gaps) < 0.25
    assert max(value for _, value in during) == pytest.approx(25.1, abs=0.1)


def test_parameter_changed_during_a_run_counts_for_the_next() -> None:
    bench = moving(still=0, type=1, count=2, straight=1)
    drive = thrown(bench)
    drive.run_until(6)
    bench.parameters |= {"SWP_AMP": 40, "SWP_PWM_MAX": 50, "SWP_CHAN": 9, "SWP_TYPE": 0, "SWP_COUNT": 1}
    bench.parameters |= {"SERVO1_TRIM": 1400, "SWP_V_MAX": 1, "SWP_ROLL_MAX": 1}
    drive.run_until(0)
    t = np.array([row["T"] for row in bench.log])
    doublet = Doublet(count=2, straight=1)
    np.testing.assert_allclose([row["Cmd"] - TRIM for row in bench.log], doublet.wave(t), atol=1e-6)
    assert t[-1] > doublet.duration - 0.08


@pytest.mark.parametrize("channel", [0, 7])
def test_switch_is_the_auxiliary_function_or_a_raw_channel(channel: int) -> None:
    bench = moving(still=0, chan=channel)
    bench.switch, bench.rc[7] = (0, 1900) if channel == 0 else (HIGH, 1100)
    drive = Drive(bench)
    drive.run(1)
    assert not bench.overrides
    bench.switch, bench.rc[7] = (HIGH, 1900) if channel == 0 else (0, 1900)
    drive.run(0.05)
    assert bench.state == 3


# ---- What goes out: within the servo's limits whatever the wave says, and never after a pause of the script.

FIVEFOLD = ("return state, envelope * offset", "return state, 5.0 * envelope * offset")
NO_LIMIT = ("math.max(run.low, math.min(run.high, pwm))", "pwm")
NO_PAUSE = ("not (paused <= OVERRIDE_MS)", "false")


def sent(source: str, kind: str = "sweep", **servo: int) -> set[int]:
    """PWM of all overrides of a run of 100 us on a servo with these SERVO1_ parameters."""
    bench = moving(**{"amp": 100, "straight": 1, "fade": 0, "dwell": 0, "trec": 5, "still": 0} | KINDS[kind])
    bench.parameters |= {f"SERVO1_{name.upper()}": value for name, value in servo.items()}
    drive = thrown(bench, source, seconds=10)
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
    drive = thrown(bench, source)
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
    drive = thrown(bench)
    drive.pause(2.0)
    bench.velocity = (2.0, 0.0, 0.0)
    drive.run(3)
    assert bench.state == 3
    drive.run(1)
    assert "stopped" not in bench.said


def let_go(channel: int | None, source: str) -> tuple[int, int]:
    """(PWM, timeout) of the last override after another output (None: none) took over steering at 0 us."""
    bench = moving(straight=0, fade=0, trec=20, still=0)
    drive = thrown(bench, source, seconds=0.5)
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
