"""A bench's folder that was damaged, or written by hand: told in a sentence, and left as it is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_servo import read_by_hand, rover

from rover_sweep.bench.bench_folder import AngleReading, BenchFolder
from rover_sweep.cli.main import run

OUTPUT = {"servo": 1, "trim": 1500.0}


@pytest.fixture
def folder(tmp_path: Path) -> BenchFolder:
    """Angles of a servo with play, read by hand."""
    made = BenchFolder(tmp_path)
    made.describe({"steering_output": OUTPUT, "wheel": None})
    readings = read_by_hand(rover(b=0.01), (80.0, 160.0, 240.0), np.random.default_rng(1))
    for t, (pwm, angle) in enumerate(zip(readings.pwm.tolist(), readings.angle.tolist(), strict=True)):
        made.add(AngleReading(float(t), "steps", pwm - 1500.0, pwm, angle))
    return made


def evaluated(folder: BenchFolder, vehicle: Path) -> int:
    return run(["bench", "--from", str(folder.path), "--vehicle", str(vehicle), "--no-write"])


def test_what_a_bench_wrote_is_evaluated(folder: BenchFolder, vehicle_toml: Path):
    assert evaluated(folder, vehicle_toml) == 0


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"steering_output": None}, "steering_output is None, not an object"),
        ({"steering_output": {"servo": 1}}, "steering_output.trim is None, not a PWM of 500 to 2500 us"),
        ({"steering_output": OUTPUT | {"trim": float("nan")}}, "steering_output.trim is nan"),
        ({"steering_output": OUTPUT | {"trim": float("inf")}}, "steering_output.trim is inf"),
        ({"steering_output": OUTPUT | {"trim": "1500"}}, "steering_output.trim is '1500'"),
        ({"steering_output": OUTPUT | {"trim": [1500]}}, "steering_output.trim is [1500]"),
        (
            {"steering_output": OUTPUT | {"servo": 1.5}},
            "steering_output.servo is 1.5, not an output from 1 to 16",
        ),
        ({"steering_output": OUTPUT | {"servo": True}}, "steering_output.servo is True"),
        ({"steering_output": OUTPUT | {"servo": 99}}, "steering_output.servo is 99"),
        ({"wheel": "imu.csv"}, "wheel is 'imu.csv', neither null nor an object"),
        ({"wheel": {"same_clock": "no"}}, "wheel.same_clock is 'no', neither true nor false"),
    ],
)
def test_a_value_that_no_bench_writes_is_named(
    folder: BenchFolder,
    vehicle_toml: Path,
    wrong: dict[str, Any],
    words: str,
    capsys: pytest.CaptureFixture[str],
):
    path = folder.path / "bench.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | wrong))
    before = path.read_bytes()
    assert evaluated(folder, vehicle_toml) == 3
    said = capsys.readouterr().err
    assert f"bench.json is damaged: {words}" in said and said.count("\n") == 1
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b"1.0,steps,nan,1500,0.1,\n", "it has nan as a time or PWM"),
        (b"1.0,steps,0,inf,0.1,\n", "it has inf as a time or PWM"),
        (b"1.0,steps,0,x,0.1,\n", "could not convert string to float: 'x'"),
        (b"\xff\xfe\n", "can't decode"),
    ],
)
def test_a_reading_that_is_none_is_named(
    folder: BenchFolder, vehicle_toml: Path, line: bytes, words: str, capsys: pytest.CaptureFixture[str]
):
    path = folder.path / "readings.csv"
    path.write_bytes(path.read_bytes() + line)
    assert evaluated(folder, vehicle_toml) == 3
    assert "readings.csv is damaged: " in (said := capsys.readouterr().err) and words in said
