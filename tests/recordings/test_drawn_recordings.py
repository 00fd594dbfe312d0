"""The bench of recordings in short: its truth, its faults, its judge, and a dozen drawn logs."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from tests.engines.engine import drawn_rover
from tests.foreign.rover import SIZES
from tests.recordings.draw import PROFILES, Wanted, drawn_log
from tests.recordings.faults import BY_NAME, FAULTS
from tests.recordings.judge import answered, figures, line, marked, table, true_value
from tests.recordings.rovers import SITL, true_numbers

SEED, SECONDS = 11, 75.0


def wanted(fault: str, profile: str, seconds: float = SECONDS) -> Wanted:
    driving = "sweep" if profile == "applet .BIN" else "by hand"
    return Wanted(fault, profile, driving, "foreign", seconds)


@pytest.mark.parametrize("engine", ["foreign", SITL])
def test_steps_show_the_numbers_of_the_single_track(engine):
    """Of a linear rover they are those of Pacejka 2012, 1.3, and the delay of slow steering."""
    rover = drawn_rover(np.random.default_rng(4), SIZES[1])
    n, found = rover.numbers, true_numbers(engine, rover, mirrored=True)
    base, both = n.a + n.b, n.Cf * n.Cr * (n.a + n.b)
    assert found.curvature == pytest.approx(100 * rover.rad_per_us / base, rel=0.01)
    understeer = n.m / base**2 * (n.b / n.Cf - n.a / n.Cr)
    assert found.understeer == pytest.approx(understeer, abs=0.002)
    for v, lag in zip(found.speeds, found.lag, strict=True):
        d1 = n.m * (n.a**2 * n.Cf + n.b**2 * n.Cr) + n.Izz * (n.Cf + n.Cr)
        d0 = both * base / v - n.m * v * (n.a * n.Cf - n.b * n.Cr)
        late = d1 / d0 - n.a * n.Cf * n.m * v / both + 1 / n.gain
        assert lag == pytest.approx(late, abs=0.004)
    far = (400 + abs(rover.trim_us - 1500)) * rover.rad_per_us
    assert found.tightest == pytest.approx(base / np.tan(far), rel=0.05)
    assert found.direction == 1 and found.straight == pytest.approx(3000 - rover.trim_us)


def digest(folder: Path) -> str:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def test_a_seed_and_a_number_draw_the_same_log(tmp_path):
    one = drawn_log(SEED, 3, tmp_path / "one", wanted("none", "factory .BIN", 20.0))
    again = drawn_log(SEED, 3, tmp_path / "again", wanted("none", "factory .BIN", 20.0))
    other = drawn_log(SEED, 4, tmp_path / "other", wanted("none", "factory .BIN", 20.0))
    assert one.truth == again.truth != other.truth
    assert digest(tmp_path / "one") == digest(tmp_path / "again") != digest(tmp_path / "other")


@pytest.mark.parametrize("fault", FAULTS, ids=[fault.name for fault in FAULTS])
def test_a_fault_is_in_the_file_and_not_in_its_truth(fault, tmp_path):
    profile = next(p for p in fault.profiles if p != "applet .BIN")
    clean = drawn_log(SEED, 5, tmp_path / "clean", wanted("none", profile, 30.0))
    bad = drawn_log(SEED, 5, tmp_path / "bad", wanted(fault.name, profile, 30.0))
    assert digest(tmp_path / "clean") != digest(tmp_path / "bad")
    assert bad.fault == fault.name and bad.left_out == fault.left_out
    assert bad.truth.curvature == clean.truth.curvature or fault.engines
    assert not fault.says("")


def test_about_half_of_the_kinds_are_left_out():
    assert len(FAULTS) == len(BY_NAME) == 24
    assert sum(fault.left_out for fault in FAULTS) == 12


AXES_BY_NAMES = "csv joined"  # in the firmware's axes, which only its names and a_z say


@pytest.mark.parametrize("profile", [p for p in PROFILES if p not in ("tlog 25 Hz", "tlog 50 Hz")])
def test_a_clean_log_gets_no_wrong_good(profile, tmp_path):
    """A dozen drives by hand and by the applet. What of another system cannot be read gets a sentence."""
    if profile in ("ulog", "ros"):
        pytest.importorskip({"ulog": "pyulog", "ros": "rosbags"}[profile])
    log = drawn_log(SEED, 6, tmp_path, wanted("none", profile))
    answer = answered(log)
    mark = marked(log.document(), answer)
    assert mark.level != "crashed", answer["text"]
    if mark.level == "good":
        gains = [
            near for name, near in mark.near.items() if name in ("curvature", "wheelbase_seen", "full_radius")
        ]
        assert gains == [True], line(mark)
        assert mark.direction is not False or profile == AXES_BY_NAMES, line(mark)
    elif mark.level in ("refused", "none"):
        assert profile.startswith("csv") and len(answer["text"]) > 30, line(mark)


# ---- The judge, by answers that are made up.


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """(log, right answer)."""
    log = drawn_log(SEED, 7, tmp_path_factory.mktemp("log"), wanted("none", "factory .BIN", 20.0)).document()
    answer = {
        "level": "good",
        "gain": 1.0,
        "speed": 1.5,
        "used": 600.0,
        "text": "",
        "took": 1.0,
        "numbers": {},
    }
    names = ("curvature", "straight", "response_time", "understeer")
    answer["numbers"] = dict.fromkeys(names, [0.0, 0.0, 0.0, ""])
    for name in names:
        true = true_value(name, log, answer)
        answer["numbers"][name] = [true * 1.01, true - abs(true) * 0.05, true + abs(true) * 0.05, "-"]
    answer["gain"] = float(log["truth"]["direction"])
    return log, answer


def test_a_right_answer_passes(judged):
    mark = marked(*judged)
    assert (
        mark.holds and mark.direction and not mark.wrong and set(mark.near) == {"curvature", "response_time"}
    )
    assert "FALL SHORT" not in figures([mark])
    assert "right" in line(mark)


@pytest.mark.parametrize("kind", ["interval", "ten percent", "direction"])
def test_a_wrong_good_falls_short(judged, kind):
    log, answer = judged
    value, low, high, unit = answer["numbers"]["curvature"]
    changed = {
        "interval": {"numbers": {**answer["numbers"], "curvature": [value, high * 1.001, high * 1.1, unit]}},
        "ten percent": {"numbers": {**answer["numbers"], "curvature": [value * 1.2, low, 2 * high, unit]}},
        "direction": {"gain": -answer["gain"]},
    }[kind]
    mark = marked(log, {**answer, **changed})
    assert mark.wrong and "WRONG" in line(mark)
    shown = [text for text in figures([marked(log, answer), mark]).splitlines() if text.startswith("FALL")]
    assert shown and all(
        ("hold" in t, "10 %" in t, "dir" in t)[("interval", "ten percent", "direction").index(kind)]
        for t in shown
    )


def test_faults_are_counted_in_their_own_rows(judged):
    log, answer = judged
    none = {**answer, "level": "none", "numbers": {}, "text": "two rovers: the logs do not agree"}
    named = marked({**log, "fault": "two rovers", "left_out": True}, none)
    silent = marked({**log, "fault": "NaN", "left_out": False}, answer)
    rows = {row[:33].strip(): row.split() for row in table([named, silent]).splitlines()}
    assert named.named and not silent.named
    assert rows["faults left out"][-1] == "1" and rows["faults tuned on"][-1] == "0"
    assert rows["two rovers"][-4] == "1"  # no answer


def test_an_angle_is_judged_in_its_own_unit(judged):
    """The sign of a steering angle depends on the axes; a normalised one is in shares of its full angle."""
    log, answer = judged
    truth = log["truth"]
    at_rest = {**answer, "numbers": {**answer["numbers"], "wheelbase_seen": [0.3, 0.2, 0.4, "m"]}}
    angle = {**log, "steering": "command", "per": 0.35}
    seen = true_value("wheelbase_seen", angle, at_rest)
    assert seen == pytest.approx(truth["wheelbase"] / 0.35, rel=0.02)
    measured = {**log, "steering": "angle"}
    assert true_value("delay", measured, at_rest) == 0.0
    assert true_value("response_time", measured, at_rest) < true_value("response_time", log, at_rest)
