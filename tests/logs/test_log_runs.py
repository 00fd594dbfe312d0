"""Finding the runs in a log: by the applet's states, by its messages, by the steering alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import applet_rows, drive, log_of, signal
from recordings import DEFAULTS, NOMINAL

from rover_sweep.errors import DataRefused
from rover_sweep.logs.applet import throttle_runs
from rover_sweep.logs.find import find_runs
from rover_sweep.logs.judgement import with_notes
from rover_sweep.logs.log import AppletRows
from rover_sweep.logs.read import read_logs, read_runs
from rover_sweep.logs.readers.vehicle_clock import paired
from rover_sweep.logs.wave import kind_of
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Manoeuvre, Sweep

SWEEP: Manoeuvre = Sweep(amplitude=100, t_rec=30, w_min=0.8)
DOUBLET: Manoeuvre = Doublet(amplitude=120)


def test_runs_by_hand_are_found_from_the_steering_alone() -> None:
    driven = [SWEEP, DOUBLET, SWEEP]
    log, starts = drive(driven)
    runs = find_runs(log)
    assert [r.kind for r in runs] == ["sweep", "doublet", "sweep"]
    for found, start, manoeuvre in zip(runs, starts, driven, strict=True):
        assert found.span[0] == pytest.approx(start, abs=1.0)
        last = start + manoeuvre.duration - manoeuvre.straight
        assert last - 2.5 < found.span[1] < last + 3.5
        assert found.mean_speed == pytest.approx(2.0)
        assert len(found.standstill) == 2
        assert found.bias("r") == 0.0
    assert [r.name for r in runs] == ["made run 1", "made run 2", "made run 3"]


@pytest.mark.parametrize("source", [NOMINAL / "run1.BIN", NOMINAL / "run4.BIN", DEFAULTS / "run1.BIN"])
def test_recordings_need_neither_applet_nor_messages(source: object) -> None:
    (log,) = read_logs(str(source))
    (by_states,) = find_runs(log)
    (by_messages,) = find_runs(replace(log, applet=None))
    (alone,) = find_runs(replace(log, applet=None, marks=()))
    assert by_states.kind == by_messages.kind == alone.kind != "other"
    for other in (by_messages, alone):  # the old applet's rows hold some straight driving too
        assert by_states.span[0] - 0.1 <= other.span[0] <= by_states.span[0] + 1.2
        assert by_states.span[1] - 4.0 <= other.span[1] <= by_states.span[1] + 0.1


def test_two_runs_in_one_log_keep_apart() -> None:
    log, (one, two) = drive([SWEEP, DOUBLET], pause=4.0)
    first = applet_rows(
        log.steering[0].t,
        1,
        [(one, 3), (one + 3, 4), (one + 7, 6), (one + 37, 7), (one + 39, 8), (one + 42, 0)],
    )
    second = applet_rows(log.steering[0].t, 2, [(two, 3), (two + 3, 6), (two + 11, 8), (two + 14, 0)])
    rows = AppletRows(
        *(
            np.concatenate(c)
            for c in zip(*((a.t, a.run, a.state, a.clock) for a in (first, second)), strict=True)
        )
    )
    runs = find_runs(replace(log, applet=rows))
    assert [(r.name, r.kind) for r in runs] == [("made run 1", "sweep"), ("made run 2", "doublet")]
    assert runs[0].span[1] <= runs[1].span[0]


def test_a_stopped_run_ends_where_the_pilot_took_over_and_says_why() -> None:
    log, (start,) = drive([SWEEP])
    rows = applet_rows(
        log.steering[0].t, 3, [(start, 3), (start + 3, 4), (start + 7, 6), (start + 25, 10), (start + 26, 0)]
    )
    marks = ((start, "SWP: run 3 start sweep"), (start + 25.1, "SWP: run 3 stopped: roll 31 > 30 deg"))
    (run,) = find_runs(replace(log, applet=rows, marks=marks))
    assert run.span[1] == pytest.approx(start + 25, abs=0.05)
    assert any("roll 31 > 30 deg" in n.text and n.level == "warning" for n in run.notes)


def test_halts_separate_runs_and_short_dips_do_not() -> None:
    t = np.arange(0, 60, 0.02)
    pwm = 1500 + 100 * np.sin(2 * t) * ((t > 3) & (t < 57))
    dip = np.where((t > 20) & (t < 20.5), 0.1, 2.0)
    assert len(find_runs(log_of(t, pwm, dip))) == 1
    halt = np.where((t > 20) & (t < 24), 0.0, 2.0)
    assert len(find_runs(log_of(t, pwm, halt))) == 2


def test_a_driver_who_holds_the_stick_drives_no_doublet() -> None:
    """Drives of 68 to 361 s at full lock and at rest, as many seconds left as right, were held out."""
    lengths = np.random.default_rng(2).uniform(0.4, 3.0, 60)
    steps = np.tile([150.0, -150.0, 0.0], 20)
    lengths[1::3] *= lengths[::3].sum() / lengths[1::3].sum()
    t = np.arange(0, 6 + lengths.sum(), 0.02)
    k = np.searchsorted(3 + np.cumsum(np.concatenate(([0.0], lengths))), t, "right")
    by_hand = signal(t, 1500 + np.concatenate(([0.0], steps, [0.0]))[k], "us", hold=True)
    assert kind_of(by_hand, 2.9, float(t[-1]) - 2.9) == "other"


def test_notes_on_gaps_uneven_sampling_and_end_stops() -> None:
    log, _ = drive([SWEEP])
    t, r = log.signals["r"].t, log.signals["r"].x
    keep = (t < 40) | (t > 40.4)
    jitter = np.sort(t + np.random.default_rng(2).uniform(-0.0045, 0.0045, t.size))
    poor = replace(
        log,
        signals={
            **log.signals,
            "r": replace(signal(t[keep], r[keep], "rad/s"), source="IMU.GyrZ"),
            "ay": replace(signal(jitter, r, "m/s^2"), source="ACC.AccY"),
            "p": replace(signal(t, np.where((t > 40) & (t < 41), 34.9, 0.0), "rad/s"), source="GYR.GyrX"),
        },
        limits=(1400.0, 1600.0),
    )
    (run,) = (with_notes(r, poor) for r in find_runs(poor))
    text = " | ".join(n.text for n in run.notes)
    assert "IMU has 1 gaps (more than 30 ms), the longest 0.42 s at 40.0 s" in text
    assert "ACC is sampled unevenly" in text
    assert "end stop (1400 or 1600 us)" in text
    assert "p reaches 34.9 rad/s" in text
    (clean,) = (with_notes(r, log) for r in find_runs(log))
    assert clean.notes == ()


def test_a_pair_that_covers_a_part_of_the_log_says_so() -> None:
    flash, _ = drive([SWEEP, SWEEP])
    half = flash.steering[0].between(0.0, 70.0)
    telemetry = replace(flash, name="part", signals={}, steering=(replace(half, hold=False),))
    coarse = replace(flash, steering=(replace(flash.steering[0].between(0, 1e9), hold=False),))
    log = paired(replace(coarse, signals={**coarse.signals}), (telemetry,))
    assert any("covers 0 to 70 s of the log's" in n.text for n in log.notes)
    whole = paired(coarse, (replace(telemetry, steering=coarse.steering),))
    assert not whole.notes


# ---- A multisine and a sweep about a bias are recognised by their wave, and by what the applet said.

MULTISINE = Multisine(t_rec=40)


@pytest.mark.parametrize("rate", [40.0])
@pytest.mark.parametrize(
    "manoeuvre",
    [
        MULTISINE,
        Multisine(t_rec=40, periods=2),
        Multisine(t_rec=60, periods=6, w_max=12),
        BiasSweep(bias=100),
        BiasSweep(amplitude=80, bias=-200),
        Sweep(),
        Doublet(),
    ],
    ids=lambda m: m.kind,
)
def test_wave_alone_tells_the_kind(manoeuvre: Manoeuvre, rate: float) -> None:
    t = np.arange(0.0, manoeuvre.duration, 1 / rate)
    steering = signal(t, np.round(1500 + manoeuvre.wave(t)), "us", hold=True)
    assert kind_of(steering, 3.0, manoeuvre.duration - 3.0) == manoeuvre.kind


def weaving(t: np.ndarray) -> np.ndarray:
    """A driver that weaves: a sine whose pace and width wander."""
    rng = np.random.default_rng(3)
    wander = np.cumsum(rng.standard_normal((2, t.size)), axis=1) * np.sqrt(t[1] - t[0])
    return np.asarray((100 + 8 * wander[0]) * np.sin(2.0 * t + 0.4 * wander[1]))


def test_weaving_and_a_mere_sine_are_no_multisine() -> None:
    t = np.arange(0.0, 60.0, 0.02)
    for wave in (weaving(t), 100 * np.sin(2.0 * t), 80 * np.sin(2.0 * t) + 10 * np.sin(6.0 * t)):
        assert kind_of(signal(t, 1500 + wave, "us", hold=True), 0.0, 60.0) == "other"


@pytest.mark.parametrize(
    ("manoeuvre", "name"), [(Multisine(t_rec=40, w_max=12), "multisine"), (BiasSweep(t_rec=30), "bias sweep")]
)
def test_word_of_the_applet_counts(manoeuvre: Manoeuvre, name: str) -> None:
    log, (start,) = drive([manoeuvre])
    marks = ((start, f"SWP: run 1 start {name}"), (start + manoeuvre.duration, "SWP: run 1 done"))
    (run,) = find_runs(replace(log, marks=marks))
    assert run.kind == manoeuvre.kind
    slow = replace(log.steering[0], t=log.steering[0].t[::12], x=log.steering[0].x[::12])
    (run,) = find_runs(replace(log, marks=marks, steering=(slow,)))  # 8 Hz tell no wave
    assert run.kind == manoeuvre.kind


# ---- A throttle sweep in a log of the real firmware: found, not taken for steering, near the truth.

THROTTLE = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "throttle" / "sweep.BIN"
STEERED = Path(__file__).parents[1] / "data" / "ardurover-4.6.3" / "nominal" / "run1.BIN"


def test_found_with_its_times_and_limits_and_is_no_steering_run() -> None:
    (log,) = read_logs(str(THROTTLE))
    (run,) = throttle_runs(log)
    assert run.span[1] - run.span[0] == pytest.approx(72.0, abs=0.2)
    assert (run.neutral_us, run.travel_us, run.swept, run.stopped) == (1500, 400, pytest.approx((0.2, 8)), "")
    sent = run.pwm.between(*run.span).x
    assert (sent[0], sent.max(), sent.min()) == (1692, 1752, 1632)
    with pytest.raises(DataRefused):
        read_runs(str(THROTTLE))
    (steered,) = read_logs(str(STEERED))
    assert throttle_runs(steered) == ()


def test_moving_by_hand_is_no_standstill() -> None:
    t = np.arange(0, 60, 0.02)
    log = log_of(t, np.full(t.size, 1500.0), np.where(t > 30, 2.0, 0.0))
    carried = replace(
        log, signals={**log.signals, "r": signal(t, 0.5 * np.sin(3 * t) * ((t < 20) | (t > 35)), "rad/s")}
    )
    (run,) = find_runs(
        replace(
            carried,
            steering=(signal(t, np.where(t > 35, 1500 + 50 * np.sin(t), 1500.0).astype(float), "us"),),
        )
    )
    assert all(a >= 19.9 for a, _ in run.standstill) and run.standstill


def test_the_old_applets_clock_restarts_with_each_run() -> None:
    log, (one, two) = drive([SWEEP, SWEEP])
    t = log.steering[0].t
    inside = [(s + 3, s + 39) for s in (one, two)]
    part = [t[(t >= a) & (t < b)] for a, b in inside]
    clock = np.concatenate([p - p[0] for p in part])
    both = np.concatenate(part)
    rows = AppletRows(both, np.ones(both.size), np.full(both.size, 2.0), clock)
    assert [r.kind for r in find_runs(replace(log, applet=rows))] == ["sweep", "sweep"]
