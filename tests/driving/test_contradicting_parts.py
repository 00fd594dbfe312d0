"""The right reason: contradicting parts of a drive, a steering that is no angle, one short manoeuvre."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from any_drives import STEP, hand_driving, recorded

import rover_sweep as rs
from rover_sweep.driving.answer import answer_from
from rover_sweep.logs.log import Log
from rover_sweep.logs.read import read_logs
from rover_sweep.report.driving import driving_report
from rover_sweep.report.on_terminal import on_terminal
from sitl.plant.variant import load_variant

ROVER = load_variant("nominal")
WHEELBASE = ROVER.cg_to_front_axle + ROVER.cg_to_rear_axle
CURVATURE = ROVER.rad_per_us / WHEELBASE  # 1/m per us, at low speed; the rover is neutral
SECONDS = 90


def one_speed(seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Steering by hand at 2 m/s."""
    steering, speed = hand_driving(seconds, rng)
    return steering, 0 * speed + 2.0


@pytest.fixture(scope="module", params=[hand_driving, one_speed])
def drive(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Log:
    """A drive of which nothing is wrong."""
    path = tmp_path_factory.mktemp("drive") / "drive.BIN"
    (log,) = read_logs(str(recorded(*request.param(SECONDS, np.random.default_rng(4)), ROVER, path, 4)))
    first, last = float(log.signals["r"].t[0]) + 10, float(log.signals["r"].t[-1])  # it is at its speed
    signals = {name: s.between(first, last) for name, s in log.signals.items()}
    return replace(log, signals=signals, steering=(log.steering[0].between(first, last),))


def from_then_on(log: Log, name: str, factor: float, at: float) -> Log:
    """The log with a channel times `factor` from the time `at` [s] on."""
    s = log.signals[name]
    return replace(log, signals={**log.signals, name: replace(s, x=np.where(s.t > at, factor * s.x, s.x))})


def half_way(log: Log) -> float:
    t = log.signals["r"].t
    return float(t[0] + t[-1]) / 2


@pytest.mark.parametrize("factor", [0.34, 2.5])
def test_a_speed_that_jumps_is_told_with_its_moment_and_is_never_good(drive: Log, factor: float) -> None:
    """As a yaw that jumps by 70 degrees makes the forward speed: V cos 70."""
    at = half_way(drive)
    answer = answer_from([from_then_on(drive, "speed", factor, at)])
    assert answer.level != "good"
    (why,) = [words for words in answer.reasons if "contradict each other" in words]
    assert "the recorded speed changed by the inverse" in why and "heading" in why
    said = float(why.split("from about ")[1].split(" s of")[0])
    assert said == pytest.approx(at, abs=6.0)
    assert not any("too little driving" in words for words in answer.reasons)


def test_a_steering_that_turns_the_other_way_half_way_is_a_contradiction(drive: Log) -> None:
    s, at = drive.steering[0], half_way(drive)
    turned = replace(drive, steering=(replace(s, x=np.where(s.t > at, 3000 - s.x, s.x)),))
    answer = answer_from([turned])
    assert answer.level == "none"
    assert any("turns to the other side" in words for words in answer.reasons), answer.reasons


def test_a_drive_without_a_jump_contradicts_nothing(drive: Log) -> None:
    answer = answer_from([drive])
    assert answer.level == "good" and not answer.reasons


def test_little_driving_is_still_called_little(drive: Log) -> None:
    """10 s with hardly any steering: no part contradicts another."""
    first = float(drive.signals["r"].t[0]) + 20
    channels = {name: s.between(first, first + 10) for name, s in drive.signals.items()}
    rng = np.random.default_rng(1)
    r = channels["r"]
    channels["r"] = replace(r, x=rng.normal(0, 0.4, r.t.size))
    steering = (drive.steering[0].between(first, first + 10),)
    answer = answer_from([replace(drive, signals=channels, steering=steering)])
    assert answer.level == "none"
    assert not any("contradict" in words for words in answer.reasons)


def test_one_short_manoeuvre_is_tested_on_its_own_halves(drive: Log) -> None:
    """10 s of steering in 30 s: the other half of the drive shows no steering, and fits anything."""
    s = drive.steering[0]
    first = float(s.t[0]) + 30
    t = np.arange(first, first + 30, STEP)
    size = 120 * np.sin(2 * np.pi * 0.7 * (t - first)) * ((t > first + 2) & (t < first + 12))
    turn = np.interp(t - 0.08, t, 2.0 * size * -CURVATURE)
    rng = np.random.default_rng(2)
    signals = {
        "speed": replace(drive.signals["speed"], t=t, x=0 * t + 2.0),
        "r": replace(drive.signals["r"], t=t, x=turn + rng.normal(0, 0.01, t.size)),
    }
    answer = answer_from([replace(drive, signals=signals, steering=(replace(s, t=t, x=1500 + size),))])
    assert answer.fit is not None and answer.fit.explained > 0.9
    assert answer.level != "none", answer.reasons


def test_a_stick_gives_a_radius_and_no_wheelbase(drive: Log, tmp_path: Path) -> None:
    """Steering in -1 to 1, as of a joystick: 300 us of travel are full steering."""
    t = drive.signals["r"].t
    stick = (drive.steering[0].on(t) - 1500) / 300
    rows = np.column_stack((t, stick, drive.signals["r"].x, drive.signals["speed"].on(t)))
    path = tmp_path / "drive.csv"
    np.savetxt(path, rows, delimiter=",", header="t,stick,r,v", comments="")
    full = {"column": "stick", "unit": "full"}
    columns = {"time": "t", "delta": full, "r": "r", "speed": "v", "runs": "whole"}
    answer = rs.identify_driving(path, columns=columns)
    assert not [q for q in answer.numbers if q.name.startswith("wheelbase")]
    radius = answer.numbers["full_radius"]
    assert radius.value == pytest.approx(1 / (300 * CURVATURE), rel=0.05)
    said = on_terminal(driving_report(answer, "drive"))
    text = "".join(str(part) for part in getattr(said, "renderables", [said]))
    assert "m wheelbase" not in text
