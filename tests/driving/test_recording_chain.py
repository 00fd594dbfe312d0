"""What is not known of a recording is in the intervals: steering between samples, the gyro's filter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from any_drives import STEP, hand_driving, recorded, true_steering

import rover_sweep as rs
from rover_sweep.data.recording import ASSUMED, Array, LowPass, Signal
from rover_sweep.driving.answer import DrivingAnswer, answer_from
from rover_sweep.logs.log import GYRO_FACTORY_HZ, Log
from rover_sweep.logs.read import read_logs
from sitl.plant.variant import load_variant

ROVER = load_variant("nominal")
SPEED = 2.0  # m/s
CURVATURE = true_steering(ROVER, SPEED).curvature
LOOP = {"SCHED_LOOP_RATE": 50.0}
RECORDED_FILTER = 20.0  # Hz, of any_drives


def swept(seconds: float) -> Array:
    """(n,) us about neutral: slow to 3.5 Hz, where 10 Hz gives less than three samples a period."""
    t = STEP * np.arange(round(seconds / STEP))
    hz = 0.2 * (3.5 / 0.2) ** (t / seconds)
    return np.asarray(120 * np.sin(2 * np.pi * STEP * np.cumsum(hz)))


def stepped(seconds: float) -> Array:
    """(n,) us about neutral: doublets of 2.4 s, at rest before them."""
    k = np.arange(round(seconds / STEP)) % round(8 / STEP) - round(4 / STEP)
    right, left = (k >= 0) & (k < 60), (k >= 60) & (k < 120)
    return np.asarray(120.0 * right - 120.0 * left)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Log, ...]]:
    """By kind of driving, with the output of every main loop."""
    folder, found = tmp_path_factory.mktemp("chain"), {}
    drives = {
        name: (us, np.full(us.size, SPEED)) for name, us in (("sweep", swept(60)), ("steps", stepped(60)))
    }
    drives["by hand"] = hand_driving(100, np.random.default_rng(6))
    for name, (steering, speed) in drives.items():
        path = folder / f"{name}.BIN"
        recorded(steering, speed, ROVER, path, 6)
        found[name] = tuple(read_logs(str(path)))
    return found


def seldom(log: Log, phase: int = 0) -> Log:
    """Every fifth output, at the begin of its loop, as RCOU."""
    s = log.steering[0]
    few = Signal(s.t[phase::5] - 0.5 * STEP, s.x[phase::5], s.unit, "RCOU.C1")
    return replace(log, steering=(few,), parameters={**log.parameters, **LOOP})


def holds(answer: DrivingAnswer, name: str, truth: float) -> bool:
    q = answer.numbers[name]
    assert q.low is not None and q.high is not None
    return q.low < truth < q.high


def whole(logs: tuple[Log, ...], name: str) -> float:
    """The number that every output and sample of the same drive give."""
    return answer_from(logs).numbers[name].value


@pytest.mark.parametrize("driving", ["sweep", "by hand"])
def test_steering_at_ten_hertz_leaves_the_truth_in_the_intervals(
    logs: dict[str, tuple[Log, ...]], driving: str
) -> None:
    """Straight lines between the samples made the sweep's curvature 8 % and its time 10 ms wrong."""
    answer = answer_from([seldom(log) for log in logs[driving]])
    assert answer.level == "good"
    assert holds(answer, "curvature", CURVATURE)
    assert holds(answer, "response_time", whole(logs[driving], "response_time"))
    assert holds(answer, "delay", ROVER.servo_delay)


@pytest.mark.parametrize("phase", [0, 2, 4])
def test_steps_at_one_phase_of_the_clock_do_not_show_their_time(
    logs: dict[str, tuple[Log, ...]], phase: int
) -> None:
    """However many there are: each may be at the begin or at the end of its 100 ms."""
    answer = answer_from([seldom(log, phase) for log in logs["steps"]])
    assert holds(answer, "curvature", CURVATURE)
    if "response_time" in answer.numbers:
        assert holds(answer, "response_time", whole(logs["steps"], "response_time"))
    else:
        assert any(words.startswith("How late the turn follows") for words in answer.unknown)


@pytest.mark.parametrize("hz", [10, 25])
def test_a_yaw_rate_that_was_sampled_seldom_is_compared_at_its_samples(
    logs: dict[str, tuple[Log, ...]], hz: int
) -> None:
    """As in a .tlog: lines between samples of the yaw rate are no yaw rate."""
    (log,), every = logs["by hand"], round(1 / (hz * STEP))
    r, s = log.signals["r"], log.steering[0]
    thin = r.t.size // round((r.t[-1] - r.t[0]) * hz)
    few = replace(r, t=r.t[::thin], x=r.x[::thin])
    outputs = Signal(s.t[::every] - 0.5 * STEP, s.x[::every], s.unit, "SERVO_OUTPUT_RAW.servo1_raw")
    slow = replace(log, signals={**log.signals, "r": few}, steering=(outputs,), parameters=LOOP)
    answer = answer_from([slow])
    assert holds(answer, "curvature", CURVATURE)
    assert holds(answer, "response_time", whole((log,), "response_time"))


def test_an_unknown_low_pass_of_the_gyro_is_part_of_the_interval(logs: dict[str, tuple[Log, ...]]) -> None:
    """It allows for the factory's and for none, and holds the truth behind 20 Hz."""
    (log,) = logs["by hand"]
    answer = answer_from([replace(log, filters={"r": LowPass(GYRO_FACTORY_HZ, ASSUMED)})])
    low, high = of_response(answer)
    assert low < whole((log,), "response_time") < high
    for filters in ({"r": LowPass(GYRO_FACTORY_HZ, "INS_GYRO_FILTER")}, {}):
        known = answer_from([replace(log, filters=filters)])
        ends = of_response(known)
        assert low < known.numbers["response_time"].value < high
        assert high - low > 3 * (ends[1] - ends[0])


def test_a_file_of_another_system_does_not_tell_how_its_gyro_is_filtered(
    logs: dict[str, tuple[Log, ...]],
) -> None:
    """Its response time allows for 20 Hz and for none."""
    (log,) = logs["by hand"]
    angle = replace(log.steering[0], x=-1e-3 * (log.steering[0].x - 1500.0), unit="rad")
    foreign = replace(log, steering=(angle,), filters={}, parameters={}, vehicle="")
    low, high = of_response(answer_from([foreign]))
    found = [
        answer_from([replace(foreign, filters={"r": LowPass(hz, "column map")})])
        .numbers["response_time"]
        .value
        for hz in (20.0, 60.0, 400.0)
    ]
    assert found == sorted(found)
    assert low < found[0] and found[-1] < high


def of_response(answer: DrivingAnswer) -> tuple[float, float]:
    """The interval of delay and lags together [s], where it is too wide to be said too."""
    assert answer.fit is not None
    slopes = {"delay": 1.0, "lag": 1.0, "tyre_lag": answer.speeds[1]}
    return answer.fit.interval(slopes, sum(answer.fit[name] * slope for name, slope in slopes.items()))


def test_the_first_note_says_how_often_the_steering_was_logged(
    logs: dict[str, tuple[Log, ...]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    log = tmp_path / "a.BIN"
    log.touch()
    monkeypatch.setattr("rover_sweep.api.driving.read_logs", lambda *_, **__: (seldom(logs["by hand"][0]),))
    first = rs.identify_driving(log).read[0]
    assert first.startswith("The steering (RCOU.C1) was logged at 10 Hz only: curvature and straight hold")
    assert "no bit of LOG_BITMASK logs it faster" in first and "applet" in first
    monkeypatch.setattr("rover_sweep.api.driving.read_logs", lambda *_, **__: logs["by hand"])
    assert not any("was logged at" in words for words in rs.identify_driving(log).read)
