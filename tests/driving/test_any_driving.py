"""Numbers of the steering from any driving: against the simulated rover that drove, and bad records."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from any_drives import hand_driving, mission, recorded, true_steering

import rover_sweep as rs
from rover_sweep.api import driving
from rover_sweep.data.recording import Signal
from rover_sweep.driving.answer import answer_from
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_logs
from sitl.plant.variant import load_variant

ROVER = load_variant("nominal")
WHEELBASE = ROVER.cg_to_front_axle + ROVER.cg_to_rear_axle
CURVATURE = true_steering(ROVER, 1.0).curvature


@pytest.fixture(scope="module", params=[hand_driving, pytest.param(mission, marks=pytest.mark.slow)])
def driven(request, tmp_path_factory):
    rng = np.random.default_rng(6)
    steering, speed = request.param(150, rng)
    path = recorded(steering, speed, ROVER, tmp_path_factory.mktemp("any") / "drive.BIN", 6)
    return path, rs.identify_driving(path, wheelbase=WHEELBASE)


def test_gain_delay_and_trim_are_the_rovers(driven):
    _, answer = driven
    found = answer.numbers
    assert answer.level == "good"
    assert found["curvature"].value == pytest.approx(CURVATURE, rel=0.03)
    assert found["rad_per_us"].value == pytest.approx(ROVER.rad_per_us, rel=0.03)
    assert found["response_time"].value == pytest.approx(
        true_steering(ROVER, answer.speeds[1]).response_time, abs=0.01
    )
    assert found["straight"].low - 3 < 1500 < found["straight"].high + 3
    assert found["delay"].low < ROVER.servo_delay < found["delay"].high
    half = {q.name: (q.high - q.low) / 2 for q in answer.numbers}
    after = dict(answer.after_sweep)  # a sweep would narrow what it shows
    assert after["curvature"] < half["curvature"]
    assert all(one <= 1.001 * half[name] for name, one in after.items())


def test_understeer_is_told_where_the_speeds_show_it(driven):
    _, answer = driven
    varied = answer.speeds[2] > 1.5 * answer.speeds[0]
    assert ("understeer_gradient" in answer.numbers) == varied
    if varied:
        q = answer.numbers["understeer_gradient"]
        assert q.low < 0.0 < q.high and q.high - q.low < 3  # a neutral rover
    else:
        assert any("all turns were driven at" in words for words in answer.unknown)


def changed(path, change):
    (log,) = read_logs(str(path))
    return [change(log)]


def with_signal(log: Log, name: str, change) -> Log:
    s = log.signals[name]
    return replace(log, signals={**log.signals, name: replace(s, x=change(s.t, s.x))})


def with_steering(log: Log, change) -> Log:
    s = log.steering[0]
    return replace(log, steering=(Signal(s.t, change(s.t, s.x), s.unit, s.source),))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda log: with_signal(log, "speed", lambda t, v: 0 * v), "only 0 s of driving"),
        (lambda log: with_steering(log, lambda t, u: 0 * u + 1500), "the steering stayed at 1500"),
        (lambda log: with_signal(log, "r", lambda t, r: 0 * r), "the yaw rate stayed at one value"),
        (
            lambda log: with_signal(log, "r", lambda t, r: np.random.default_rng(1).normal(0, 0.3, r.size)),
            "does not follow|explains",
        ),
    ],
    ids=["standstill", "constant steering", "dead gyro", "another vehicle's gyro"],
)
def test_driving_that_shows_nothing_says_why(driven, change, words):
    answer = answer_from(changed(driven[0], change))
    assert answer.level == "none" and not answer.numbers
    assert any(re.search(words, reason) for reason in answer.reasons), answer.reasons


def test_reverse_is_a_negative_speed(driven):
    """The same turn in reverse: the speed and the yaw rate change sign, the curvature does not."""

    def reverse(log):
        back = with_signal(log, "speed", lambda t, v: -v)
        return with_signal(back, "r", lambda t, r: -r)

    found = answer_from(changed(driven[0], reverse))
    assert found.numbers["curvature"].value == pytest.approx(driven[1].numbers["curvature"].value, rel=0.01)


def without_speed(log, a, b):
    s = log.signals["speed"]
    keep = (s.t < a) | (s.t > b)
    return replace(log, signals={**log.signals, "speed": replace(s, t=s.t[keep], x=s.x[keep])})


CERTAIN = 1.6  # times half the 90 % interval: 99 %
DAMAGE = (
    lambda log, a, b: with_signal(log, "r", lambda t, r: np.where((t > a) & (t < b), 0.0, r)),
    lambda log, a, b: with_steering(log, lambda t, u: np.where((t > a) & (t < b), 1500.0, u)),
    lambda log, a, b: with_signal(log, "speed", lambda t, v: np.where((t > a) & (t < b), 0.0, v)),
    lambda log, a, b: with_steering(log, lambda t, u: np.maximum(u, 1500.0)),
    without_speed,
)


@pytest.fixture(scope="module")
def long_drives(tmp_path_factory):
    """Two minutes of each kind, as logs."""
    out = []
    for k, kind in enumerate((hand_driving, mission)):
        path = tmp_path_factory.mktemp("long") / "drive.BIN"
        out += read_logs(str(recorded(*kind(120, np.random.default_rng(k)), ROVER, path, k)))
    return out


def damaged(log, seed):
    """4 to 110 s of the log with two of the damages."""
    rng = np.random.default_rng(seed)
    seconds = float(np.exp(rng.uniform(np.log(4), np.log(110))))
    first = float(rng.uniform(10, 125 - seconds))
    last = first + seconds
    signals = {n: s.between(first, last) for n, s in log.signals.items()}
    log = replace(log, signals=signals, steering=(log.steering[0].between(first, last),))
    for _ in range(2):
        a, b = np.sort(rng.uniform(first, last, 2))
        log = DAMAGE[rng.integers(len(DAMAGE))](log, a, b)
    return log


@pytest.mark.parametrize("seed", range(8))
def test_a_damaged_record_gives_an_answer_or_a_sentence(long_drives, seed):
    """Zeros, gaps, constant steering, standstill, one direction only: no traceback, no sure wrong number."""
    answer = answer_from([damaged(long_drives[seed % 2], seed)])
    assert answer.level in ("good", "rough", "none")
    assert bool(answer.numbers) != bool(answer.level == "none")
    assert answer.level != "none" or answer.reasons
    if answer.level == "good":
        q = answer.numbers["curvature"]
        sure = CERTAIN * (q.high - q.low) / 2
        assert q.value - sure < CURVATURE < q.value + sure


@pytest.mark.parametrize("wheelbase", [0, -1, float("nan"), float("inf"), 391, True, "0.4"])
def test_a_wheelbase_that_is_none_is_refused(driven, wheelbase):
    with pytest.raises(rs.UsageError, match="give metres, 0.02 to 20"):
        rs.identify_driving(driven[0], wheelbase=wheelbase)


def test_the_same_log_twice_is_refused(driven, tmp_path):
    copy = tmp_path / "copy.BIN"
    copy.symlink_to(driven[0])
    with pytest.raises(rs.UsageError, match="given twice"):
        rs.identify_driving(driven[0], copy)


def test_how_late_is_not_told_where_it_is_not_known(driven):
    """Steering that changes once in 40 s says how far, not how late."""

    def seldom(log):
        s = log.steering[0]
        few = np.where((s.t // 20) % 2 == 0, 1450.0, 1550.0)
        rate = np.interp(log.signals["r"].t, s.t, -1e-3 * (few - 1500) * 4)
        still = with_signal(with_steering(log, lambda t, u: few), "speed", lambda t, v: 0 * v + 2.0)
        rng = np.random.default_rng(3)
        return with_signal(still, "r", lambda t, r: rate + rng.normal(0, 0.1, t.size))

    answer = answer_from(changed(driven[0], seldom))
    assert "curvature" in answer.numbers and "response_time" not in answer.numbers
    assert any(words.startswith("How late the turn follows") for words in answer.unknown)


def test_the_shortest_parts_are_tested_on_each_other_too(driven, tmp_path):
    """Two parts of little more than 4 s give a share that is a number, on the page and in driving.json."""

    def brief(log):
        first = log.signals["speed"].t[0] + 20
        channels = {n: s.between(first, first + 8.5) for n, s in log.signals.items()}
        log = replace(log, signals=channels, steering=(log.steering[0].between(first, first + 8.5),))
        return with_signal(log, "speed", lambda t, v: np.where(np.abs(t - first - 4.25) < 0.1, 0.0, v))

    answer = answer_from(changed(driven[0], brief))
    assert len(answer.driving.stretches) == 2 and np.isfinite(answer.fit.explained)
    files = replace(driven[1], **{f: getattr(answer, f) for f in ("level", "numbers", "reasons", "fit")})
    document = json.loads(files.report(tmp_path).document.read_text())
    assert document["explained"] == pytest.approx(answer.fit.explained)


def test_impossible_samples_are_removed_as_from_runs(driven, monkeypatch):
    def damaged(*given, **more):
        (log,) = read_logs(*given, **more)
        bad = lambda t, v: np.where(np.arange(t.size) % 500 == 0, np.nan, v)  # noqa: E731
        return (with_signal(log, "speed", bad),)

    monkeypatch.setattr(driving, "read_logs", damaged)
    found = rs.identify_driving(driven[0]).numbers["curvature"].value
    assert found == pytest.approx(driven[1].numbers["curvature"].value, rel=0.01)


def test_a_copters_log_is_refused_by_name(driven, monkeypatch):
    def copter(*given, **more):
        return tuple(replace(log, vehicle="copter") for log in read_logs(*given, **more))

    monkeypatch.setattr(driving, "read_logs", copter)
    with pytest.raises(rs.DataRefused, match="is the log of a copter"):
        rs.identify_driving(driven[0])


def test_logs_that_disagree_give_the_numbers_of_each(tmp_path):
    """Another trim, and nothing else, or another linkage; the same rover twice is pooled."""
    rovers = {
        "one": ROVER,
        "again": ROVER,
        "trimmed": replace(ROVER, steering_trim_us=ROVER.steering_trim_us + 25),
        "other": replace(ROVER, rad_per_us=0.8 * ROVER.rad_per_us),
    }
    paths = {}
    for k, (name, rover) in enumerate(rovers.items()):
        steering, speed = hand_driving(45, np.random.default_rng(k))
        # the drive's steering is about the rover's own trim
        paths[name] = recorded(steering, speed, rover, tmp_path / f"{name}.BIN", k)
    same = rs.identify_driving(paths["one"], paths["again"])
    assert same.level == "good" and not same.each
    for name, differs in (("trimmed", "straight"), ("other", "curvature")):
        answer = rs.identify_driving(paths["one"], paths[name])
        assert answer.level == "none" and not answer.numbers
        assert f"do not agree on {differs}:" in answer.reasons[0]
        assert list(answer.each) == ["one.BIN", f"{name}.BIN"]
        page = answer.report(tmp_path / name)
        assert f"Numbers of {name}.BIN" in page.page.read_text()
        assert json.loads(page.document.read_text())["each"][f"{name}.BIN"]["numbers"]["curvature"]
        assert f"curvature of {name}.BIN" in str(answer)


def test_the_ratio_of_a_steering_wheel_is_found(tmp_path):
    """CSV in degrees at the steering wheel, 16 to 1, with the wheelbase; without it the wheelbase seen."""
    steering, speed = hand_driving(60, np.random.default_rng(3))
    (log,) = read_logs(str(recorded(steering, speed, ROVER, tmp_path / "drive.BIN", 3)))
    t = log.signals["r"].t
    turned = -np.degrees(ROVER.rad_per_us * (log.steering[0].on(t) - ROVER.steering_trim_us)) * 16
    v, r = log.signals["speed"].on(t), log.signals["r"].x
    path = tmp_path / "drive.csv"
    rows = np.column_stack((t, turned, r, v))
    np.savetxt(path, rows, delimiter=",", header="t,wheel,r,v", comments="")
    columns = {
        "time": "t",
        "delta": {"column": "wheel", "unit": "deg"},
        "r": "r",
        "speed": "v",
        "runs": "whole",
    }
    q = rs.identify_driving(path, columns=columns, wheelbase=WHEELBASE).numbers["steering_ratio"]
    assert q.value == pytest.approx(16, rel=0.03) and q.low < 16 < q.high
    seen = rs.identify_driving(path, columns=columns).numbers
    assert "steering_ratio" not in seen
    assert seen["wheelbase_seen"].value == pytest.approx(16 * WHEELBASE, rel=0.03)


def bent(side, curve):
    """The drive of a rover whose steering turns farther to larger outputs, and farther in proportion."""
    x = np.linspace(-500, 500, 2001)
    turned = x * (1 + side * np.sign(x) + curve * np.square(np.minimum(np.abs(x), 250) / 250))
    return lambda log: with_steering(log, lambda t, u: 1500 + np.interp(u - 1500, turned, x))


def test_a_number_for_each_side_where_they_differ(driven):
    plain = driven[1].numbers
    assert not {"curvature_left", "curvature_right", "steering_curve"} & set(plain.keys())
    found = answer_from(changed(driven[0], bent(0.1, 0.0))).numbers  # larger outputs turn right
    for side, share in (("right", 1.1), ("left", 0.9)):
        assert found[f"curvature_{side}"].value == pytest.approx(share * CURVATURE, rel=0.05)


def test_a_steering_that_saturates_is_told(driven):
    answer = answer_from(changed(driven[0], bent(0.0, -0.15)))
    if answer.speeds[2] < 1.5 * answer.speeds[0]:  # it looks as the bend of the tyres does
        assert "steering_curve" not in answer.numbers
        return
    q = answer.numbers["steering_curve"]
    assert q.high < 0 and "curvature_left" not in answer.numbers
    assert q.value == pytest.approx(-15 * (answer.fit.amplitude / 250) ** 2, abs=5)
    assert answer.numbers["curvature"].value == pytest.approx(CURVATURE, rel=0.04)


def test_tyres_are_told_where_the_driving_decides(driven, tmp_path):
    path, _ = driven
    file = tmp_path / "rover.toml"
    lines = [f"{n} = {getattr(ROVER, n)}" for n in ("mass", "cg_to_front_axle", "cg_to_rear_axle")]
    for inertia in (f"yaw_inertia = {ROVER.yaw_inertia}", ""):
        file.write_text("\n".join(["[vehicle]", *lines, inertia]))
        answer = rs.identify_driving(path, vehicle=file)
        assert answer.numbers["rad_per_us"].value == pytest.approx(ROVER.rad_per_us, rel=0.03)
        if inertia and answer.speeds[2] > 1.5 * answer.speeds[0]:
            for axle in ("front", "rear"):
                true = getattr(ROVER, f"{axle}_cornering_stiffness")
                assert answer.numbers[f"{axle}_stiffness"].value == pytest.approx(true, rel=0.2)
        else:
            assert "front_stiffness" not in answer.numbers
            assert any(words.startswith("Tyre stiffnesses") for words in answer.unknown)


def test_too_little_driving_is_said(driven):
    """16 s in which the steering explains nearly all."""

    def brief(log):
        channels = {n: s.between(55.0, 71.0) for n, s in log.signals.items()}
        return replace(log, signals=channels, steering=(log.steering[0].between(55.0, 71.0),))

    answer = answer_from(changed(driven[0], brief))
    assert answer.level == "none" and "too little driving" in answer.reasons[0]


def test_outputs_logged_seldom_are_dated_at_the_middle_of_their_loop(driven):
    """Every fifth output at the begin of its 20 ms, as ArduRover logs them."""

    def seldom(log):
        s = log.steering[0]
        few = Signal(s.t[::5] - 0.01, s.x[::5], s.unit, s.source)
        return replace(log, steering=(few,), parameters={**log.parameters, "SCHED_LOOP_RATE": 50.0})

    found = answer_from(changed(driven[0], seldom)).numbers["response_time"]
    assert found.value == pytest.approx(driven[1].numbers["response_time"].value, abs=0.004)
