"""Driving by hand in short trials, smoothed and at 20 Hz, of a car that hides nothing: no name is said."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_car import Recorder, SmallCar, by_hand

import rover_sweep as rs

MAP = {"time": "t", "delta": "steer", "r": "r", "speed": "v", "trial": "trial"}


@pytest.mark.slow
def test_nothing_is_named_in_smoothed_short_trials(tmp_path: Path) -> None:
    rover = tmp_path / "rover.toml"
    rover.write_text(
        "[vehicle]\nmass = 3.0\ncg_to_front_axle = 0.16\ncg_to_rear_axle = 0.16\nyaw_inertia = 0.05\n"
    )
    laws = [by_hand(seed) for seed in range(12)]
    recorder = Recorder(rate=20, smooth=51)
    source = recorder.write(tmp_path / "trials.csv", SmallCar(delay=0.03), laws, 3.5)
    fitted = rs.read(source, columns=MAP, vehicle=rover, without=f"{source}:12")
    held = rs.read(f"{source}:12", columns=MAP, vehicle=rover)
    only = ("servo_lag", "servo_rate_limit", "steering_backlash", "tyre_saturation")
    found = rs.diagnose(fitted, held, baseline="bicycle", only=only)
    assert found.verdict == "none" and not found.findings
    assert any(
        "r was smoothed or resampled: its spectrum collapses above" in remark for remark in found.remarks
    )
    for stiffness in (found.parameters["Cf"], found.parameters["Cr"]):
        assert stiffness.low is not None and stiffness.high is not None
        assert stiffness.low < 45.0 < stiffness.high
    slow = SmallCar(delay=0.03, lag=0.2)
    source = recorder.write(tmp_path / "slow.csv", slow, laws, 3.5)
    found = rs.diagnose(rs.read(source, columns=MAP, vehicle=rover), baseline="bicycle", only=only)
    assert [f.effect for f in found.findings] == ["servo_lag"]
