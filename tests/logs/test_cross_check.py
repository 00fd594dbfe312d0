"""Channels of a log that contradict each other: corrected where two are against one, else named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recordings import APPLET, DATA, DEFAULTS, NOMINAL, OLDER, STOCK

import rover_sweep as rs
from rover_sweep.data.recording import Array, Signal
from rover_sweep.logs.cross_check import CONTRADICTED, cross_checked
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_logs, runs_of, usable_log
from rover_sweep.logs.redundant_channels import channel_relations
from tests.quality.damage import rewritten
from tests.recordings.draw import Wanted, drawn_log

FOLDERS = (NOMINAL, DEFAULTS, STOCK, APPLET, OLDER, *(DATA / "concealed-ardurover").glob("?"))
SOUND = sorted(path for folder in FOLDERS for kind in ("BIN", "tlog") for path in folder.glob(f"*.{kind}"))


@pytest.fixture(scope="module")
def log() -> Log:
    (found,) = read_logs(str(NOMINAL / "run1.BIN"))
    return found


@pytest.mark.parametrize(
    "path", SOUND, ids=[f"{p.parent.parent.name}/{p.parent.name}/{p.name}" for p in SOUND]
)
def test_nothing_is_wrong_with_the_recordings(path: Path) -> None:
    for one in read_logs(str(path)):
        checked = usable_log(one)
        assert not checked.contradictions, checked.contradictions
        assert {"psi", "course", "force"} <= {relation.name for relation in channel_relations(one)}


def having(log: Log, **changes: Callable[[Array, Array], Array]) -> Log:
    """The log with channels or witnesses changed by functions of (t, x)."""

    def new(signals: dict[str, Signal]) -> dict[str, Signal]:
        return {n: replace(s, x=changes[n](s.t, s.x)) if n in changes else s for n, s in signals.items()}

    return replace(log, signals=new(dict(log.signals)), witnesses=new(dict(log.witnesses)))


def times(factor: float) -> Callable[[Array, Array], Array]:
    return lambda t, x: factor * x


def turned_heading(log: Log, by: Callable[[Array], Array]) -> Log:
    """With a heading that is wrong by an angle of time [rad], and the velocity that it turns."""
    speed, left = log.signals["speed"], log.signals["vy"]
    velocity = (speed.x + 1j * left.x) * np.exp(-1j * by(speed.t))
    signals = {"speed": replace(speed, x=velocity.real), "vy": replace(left, x=velocity.imag)}
    signals["psi"] = replace(log.signals["psi"], x=log.signals["psi"].x + by(log.signals["psi"].t))
    return replace(log, signals={**log.signals, **signals})


def same_motion(one: Log, other: Log, within: float) -> bool:
    """Whether speed and yaw rate are those of the other log."""
    both = [
        float(np.sqrt(np.mean(np.square(one.signals[c].x / scale - other.signals[c].x / scale))))
        for c in ("speed", "r", "ay")
        for scale in [float(np.std(other.signals[c].x))]
    ]
    return max(both) < within


@pytest.mark.parametrize("factor", [0.7, 1.3, 4.0])
def test_a_wrong_speed_is_corrected_where_gps_and_a_y_agree(log: Log, factor: float) -> None:
    checked = cross_checked(having(log, speed=times(factor), vy=times(factor)))
    (one,) = checked.contradictions
    assert one.channel == "speed" and one.decided and one.speed_sd < 0.03
    assert "GPS.Spd" in one.text and "a_y is" in one.text
    right = log.signals["speed"].x
    assert float(np.median(checked.signals["speed"].x / right)) == pytest.approx(1.0, abs=0.02)


def test_a_speed_against_a_y_alone_is_not_decided(log: Log) -> None:
    """One against one: both are named, nothing is corrected, and a run of it has a fault."""
    alone = replace(having(log, speed=times(4.0), vy=times(4.0)), witnesses={})
    checked = cross_checked(alone)
    (one,) = checked.contradictions
    assert one.channel == "speed" and not one.decided and one.speed_sd > 1.0
    assert "speed scale or accelerometer scale" in one.text
    assert checked.signals == alone.signals
    (run,) = runs_of(alone)
    assert CONTRADICTED in {note.fault for note in run.notes}


def test_a_wheel_radius_is_named_where_the_wheels_are_logged(log: Log) -> None:
    speed = log.signals["speed"]
    wheels = {"wheel_speed": replace(speed, x=1.3 * speed.x, source="WENC.Dist0")}
    wrong = having(replace(log, witnesses={**log.witnesses, **wheels}), speed=times(1.3), vy=times(1.3))
    (one,) = cross_checked(wrong).contradictions
    assert one.decided and one.text.startswith("the wheel radius is wrong") and "WENC_RADIUS" in one.text


def test_a_gps_that_is_wrong_accuses_no_other(log: Log) -> None:
    wrong = having(log, gps_speed=times(0.5))
    checked = cross_checked(wrong)
    (one,) = checked.contradictions
    assert one.channel == "gps_speed" and one.decided and one.text.endswith("it is not used")
    assert checked.signals == wrong.signals


def test_a_compass_backwards_is_turned(log: Log) -> None:
    wrong = turned_heading(log, lambda t: np.full(t.size, np.pi))
    assert float(np.median(wrong.signals["speed"].x)) < 0
    checked = cross_checked(wrong)
    (one,) = checked.contradictions
    assert one.channel == "heading" and one.decided and "the compass is backwards" in one.text
    assert same_motion(checked, log, 1e-9)


def test_reverse_is_no_compass_backwards(log: Log) -> None:
    """Throttle, a_y and heading agree on it."""
    back = {"speed": times(-1), "vy": times(-1), "r": times(-1), "psi": times(-1)}
    back |= {"throttle": lambda t, x: 3000 - x, "gps_course": times(-1)}
    assert not cross_checked(having(log, **back)).contradictions


def test_an_imu_upside_down_is_turned(log: Log) -> None:
    checked = cross_checked(having(log, r=times(-1), ay=times(-1)))
    (one,) = checked.contradictions
    assert one.channel == "r" and one.decided and "AHRS_ORIENTATION" in one.text
    assert same_motion(checked, log, 1e-9)


@pytest.mark.parametrize("degrees", [70.0, -110.0])
def test_a_heading_that_jumps_is_set_right(log: Log, degrees: float) -> None:
    begin = float(np.mean(log.signals["speed"].t[[0, -1]]))
    wrong = turned_heading(log, lambda t: np.radians(degrees) * (t > begin))
    checked = cross_checked(wrong)
    (one,) = checked.contradictions
    assert one.channel == "heading" and one.decided
    assert f"jumps by {abs(degrees):.0f} deg at" in one.text
    at = float(one.text.partition(" deg at ")[2].partition(" s")[0])
    assert at == pytest.approx(begin, abs=0.3)
    near = np.abs(log.signals["speed"].t - begin) > 0.5
    right, found = (one.signals["speed"].x[near] for one in (log, checked))
    assert float(np.max(np.abs(right - found))) < 0.1


def test_a_heading_aside_of_the_course_is_set_right(log: Log) -> None:
    wrong = turned_heading(log, lambda t: np.full(t.size, np.radians(40.0)))
    checked = cross_checked(wrong)
    (one,) = checked.contradictions
    assert one.channel == "heading" and one.decided
    aside = float(one.text.partition(" points ")[2].partition(" deg")[0])
    assert aside == pytest.approx(40, abs=2)
    assert same_motion(checked, log, 0.05)


def test_a_gyro_that_jumps_is_not_taken_for_a_heading(log: Log) -> None:
    """A gyro that is silent for two seconds of a turn: the heading goes on, slowly."""
    r = log.signals["r"]
    k = int(np.argmax(np.abs(r.x)))
    silent = having(log, r=lambda t, x: np.where(np.abs(t - r.t[k]) < 1.0, 0.0, x))
    assert not any(one.channel == "heading" for one in cross_checked(silent).contradictions)


@pytest.mark.parametrize("first", [True, False])
def test_of_two_records_of_the_steering_the_yaw_rate_follows_one(log: Log, first: bool) -> None:
    right = log.steering[0]
    other = replace(right, x=np.roll(right.x, right.x.size // 3), source="RCOU.C2")
    steering = (right, other) if first else (other, right)
    (one,) = cross_checked(replace(log, steering=steering)).contradictions
    assert one.channel == "steering" and one.decided == first
    assert "RCOU.C2" in one.text and right.source in one.text


# ---- In files, and in the answers.


@pytest.fixture(scope="module")
def right() -> rs.DrivingIdentification:
    return rs.identify_driving(NOMINAL / "run1.BIN")


def test_the_answer_of_a_wrong_speed_is_that_of_the_right_one(
    tmp_path: Path, right: rs.DrivingIdentification
) -> None:
    changes = {("XKF1", field): (lambda x: 4 * x) for field in ("VN", "VE")}
    found = rs.identify_driving(rewritten(NOMINAL / "run1.BIN", tmp_path / "fast.BIN", changes))
    assert found.level == "good" and not found.foreign
    q, true = found.numbers["curvature"], right.numbers["curvature"]
    assert q.value == pytest.approx(true.value, rel=0.03)
    assert q.low < true.value < q.high
    assert q.high - q.low > true.high - true.low, "the scale has an error of its own"
    assert any("times the true one" in words for words in found.read)


def test_the_turning_direction_survives_a_compass_backwards(
    tmp_path: Path, right: rs.DrivingIdentification
) -> None:
    changes = {("ATT", "Yaw"): lambda x: (x + 18000) % 36000, ("XKF1", "Yaw"): lambda x: (x + 18000) % 36000}
    found = rs.identify_driving(rewritten(NOMINAL / "run1.BIN", tmp_path / "back.BIN", changes))
    assert found.level == "good"
    assert found.numbers["curvature"].meaning == right.numbers["curvature"].meaning
    assert found.numbers["curvature"].value == pytest.approx(right.numbers["curvature"].value, rel=0.01)
    assert any("compass" in words for words in found.read)


def test_a_speed_that_nothing_decides_gives_no_number(tmp_path: Path) -> None:
    changes = {("XKF1", field): (lambda x: 4 * x) for field in ("VN", "VE")} | {
        ("GPS", "Status"): lambda _: 1
    }
    found = rs.identify_driving(rewritten(NOMINAL / "run1.BIN", tmp_path / "alone.BIN", changes))
    assert found.level == "none" and not found.numbers
    assert any("a_y is 0.2" in reason and "speed scale or" in reason for reason in found.reasons)


# ---- Recordings of other systems, with what they have.


def table(path: Path, factor: float, positions: bool) -> str:
    """A .csv of a rover of .5 m wheelbase that swings, whose speed is wrong by a factor."""
    t = np.arange(0.0, 90.0, 0.02)
    speed = 2.0 + 0.4 * np.sin(0.11 * t)
    steering = 0.15 * np.sin(0.9 * t) + 0.06 * np.sin(2.3 * t)
    r = speed * np.interp(t - 0.05, t, steering) / 0.5
    psi = np.cumsum(r) * 0.02
    noise = np.random.default_rng(5).normal(size=(3, t.size))
    columns = {
        "time": t,
        "steering_angle_cmd": steering,
        "yaw_rate": r + 0.01 * noise[0],
        "speed": factor * speed,
        "lat_acc": 1.03 * speed * r + 0.1 * noise[1],
    }
    if positions:
        columns |= {
            f"pos_{axis}": np.cumsum(speed * f(psi)) * 0.02 for axis, f in (("x", np.cos), ("y", np.sin))
        }
    rows = np.stack(list(columns.values()), 1)
    np.savetxt(path, rows, "%.5f", ",", header=",".join(columns), comments="")
    return str(path)


@pytest.mark.parametrize(("factor", "wrong"), [(1.0, False), (1.3, True), (0.7, True)])
def test_positions_decide_between_speed_and_a_y(tmp_path: Path, factor: float, wrong: bool) -> None:
    found = rs.identify_driving(table(tmp_path / "drive.csv", factor, positions=True))
    assert found.level == "good"
    assert found.numbers["wheelbase_seen"].value == pytest.approx(0.5, rel=0.04)
    assert any("times the true one" in words for words in found.read) == wrong


@pytest.mark.parametrize(("factor", "level"), [(1.0, "good"), (1.33, "rough"), (0.5, "none")])
def test_without_positions_a_wrong_speed_lowers_the_grade(tmp_path: Path, factor: float, level: str) -> None:
    found = rs.identify_driving(table(tmp_path / "drive.csv", factor, positions=False))
    assert found.level == level
    assert any("a_y is" in reason for reason in found.reasons) == (level != "good")
    if level == "rough":
        q = found.numbers["wheelbase_seen"]
        assert q.low < 0.5 < q.high, "the interval allows for either"


def test_a_velocity_of_another_scale_is_still_one_of_two(tmp_path: Path) -> None:
    """PX4's local position: with vx and vy 1.3 times too large, vx alone was taken for the speed."""
    pytest.importorskip("pyulog")
    drawn = drawn_log(4, 2, tmp_path, Wanted("speed scale", "ulog", "", "foreign", 75.0))
    found = rs.identify_driving(*drawn.sources)
    assert any("velocity vehicle_local_position.vx" in w and "times the true one" in w for w in found.read)
    seen = found.numbers["full_radius"].value
    assert seen == pytest.approx(drawn.truth.wheelbase / drawn.per, rel=0.1)
