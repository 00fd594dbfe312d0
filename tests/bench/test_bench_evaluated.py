"""What a bench finds: from angles read by hand, from an IMU on the wheel, from a folder."""

from __future__ import annotations

import json
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_servo import read_by_hand, rover, seen_by_imu, slope_by_hand

from rover_sweep.bench.bench_folder import AngleReading, BenchFolder, BenchResult
from rover_sweep.bench.by_wheel import Wheel, by_wheel
from rover_sweep.bench.evaluate import Readings, by_hand
from rover_sweep.bench.steering_output import names_of, steering_output
from rover_sweep.cli.main import run
from rover_sweep.errors import DataRefused, UsageError

DRAWS = 200
BY_HAND = (50.0, 100.0, 200.0, 300.0)


@pytest.mark.parametrize("w", [0.0, 0.012])
def test_intervals_hold_the_truth(w: float):
    parameters = rover(b=0.012, e=0.06, c3=2.0, w=w, trim=1508.0)
    rng = np.random.default_rng(11)
    truth = {
        "rad_per_us": slope_by_hand(parameters, 292.0),
        "trim_us": 1508.0,
        "backlash": 0.012,
        "asymmetry": 0.06,
        "nonlinearity": 2.0,
        "deadband": w,
    }
    held = dict.fromkeys(truth, 0)
    for _ in range(DRAWS):
        result = by_hand(read_by_hand(parameters, BY_HAND, rng), 1500.0)
        for name, value in truth.items():
            number = result.get(name)
            assert number is not None
            held[name] += number.low <= value <= number.high
    shares = {name: count / DRAWS for name, count in held.items()}
    # 90 % intervals; at a true 0 a size that cannot be negative is held more often
    assert all(0.82 <= share <= (0.98 if truth[name] == 0 else 0.96) for name, share in shares.items()), (
        shares
    )


def test_exact_angles_give_the_exact_numbers():
    parameters = rover(b=0.02, e=-0.08, c3=3.0, w=0.01, trim=1490.0)
    exact = read_by_hand(parameters, BY_HAND, np.random.default_rng(0))
    noise = np.radians(0.5) * np.random.default_rng(0).standard_normal(exact.pwm.size)
    result = by_hand(Readings(exact.pwm, exact.angle - noise, 1500.0), 1500.0)
    for name, value in (
        ("trim_us", 1490),
        ("backlash", 0.02),
        ("asymmetry", -0.08),
        ("deadband", 0.01),
        ("nonlinearity", 3.0),
        ("centre", 0.00095),
    ):
        number = result.get(name)
        assert number is not None and number.value == pytest.approx(value, rel=0.02)


def test_a_servo_that_turns_left_with_a_larger_pwm():
    readings = read_by_hand(rover(b=0.01), BY_HAND, np.random.default_rng(1))
    slope = by_hand(Readings(readings.pwm, -readings.angle, 1500.0), 1500.0).get("rad_per_us")
    assert slope is not None and slope.value == pytest.approx(-0.00095, rel=0.05)


def test_two_levels_tell_no_curve_and_say_so():
    result = by_hand(read_by_hand(rover(b=0.01), (80.0, 160.0), np.random.default_rng(2)), 1500.0)
    assert result.get("nonlinearity") is None and result.get("deadband") is None
    assert any("--steps" in text for text in result.untold)
    assert result.get("servo_lag") is None and any("servo_lag" in text for text in result.untold)


def test_angles_left_out_are_done_without():
    readings = read_by_hand(rover(b=0.012), BY_HAND, np.random.default_rng(3))
    angle = readings.angle.copy()
    angle[1::4] = np.nan
    number = by_hand(Readings(readings.pwm, angle, 1500.0), 1500.0).get("rad_per_us")
    assert number is not None and number.value == pytest.approx(0.00095, rel=0.05)


def test_too_few_angles_are_refused():
    readings = read_by_hand(rover(), BY_HAND, np.random.default_rng(4))
    with pytest.raises(DataRefused, match="4 angles were read"):
        by_hand(Readings(readings.pwm[:4], readings.angle[:4], 1500.0), 1500.0)


# ---- An IMU on the wheel: gain, curve, play, lag, rate limit and delay out of a ramp and steps.

STEPS = (120.0, 250.0)
PARAMETERS = rover(b=0.012, e=0.05, c3=3.0, w=0.006, lag=0.035, rate=3.0)
TRUTH = {
    "centre": 0.00095,
    "backlash": 0.012,
    "asymmetry": 0.05,
    "nonlinearity": 3.0,
    "deadband": 0.006,
    "servo_lag": 0.035,
    "servo_rate_limit": 3.0,
}


def values(result: BenchResult) -> dict[str, float]:
    return {number.name: number.value for number in result.numbers}


@pytest.mark.parametrize("as_rate", [False, True])
def test_all_that_is_there_is_found(as_rate: bool):
    command, wheel = seen_by_imu(PARAMETERS, STEPS, np.random.default_rng(3), as_rate)
    result = by_wheel(command, wheel, 1.0)
    found = values(result)
    assert {name: found[name] for name in TRUTH} == pytest.approx(TRUTH, rel=0.06 if as_rate else 0.03)
    delay = result.get("servo_delay")
    assert delay is not None and delay.low <= PARAMETERS.servo_delay <= delay.high
    assert result.get("trim_us") is None and any("trim_us" in text for text in result.untold)


def test_intervals_by_wheel_hold_the_truth():
    rng = np.random.default_rng(8)
    held, draws = dict.fromkeys((*TRUTH, "servo_delay"), 0), 8
    for _ in range(draws):
        result = by_wheel(*seen_by_imu(PARAMETERS, (250.0,), rng), 1.0)
        for name, value in {**TRUTH, "servo_delay": PARAMETERS.servo_delay}.items():
            number = result.get(name)
            assert number is not None
            held[name] += number.low <= value <= number.high
    assert all(count >= 5 for count in held.values()), held  # 90 %: fewer than 5 of 8 once in 200 times
    assert sum(held.values()) >= 0.8 * draws * len(held)


def test_a_clock_of_its_own_leaves_the_delay_untold():
    command, wheel = seen_by_imu(PARAMETERS, STEPS, np.random.default_rng(4), clock=inf, ahead=1.7e9)
    result = by_wheel(command, wheel, 1.0)
    assert result.get("servo_delay") is None and any("servo_delay" in text for text in result.untold)
    found = values(result)
    assert {name: found[name] for name in TRUTH} == pytest.approx(TRUTH, rel=0.05)


def test_an_imu_upside_down_is_turned_by_the_sign_in_the_vehicle_file():
    command, wheel = seen_by_imu(PARAMETERS, STEPS, np.random.default_rng(5))
    result = by_wheel(command, Wheel(wheel.t, -wheel.value, False, 0.0), 1.0)
    assert values(result)["asymmetry"] == pytest.approx(0.05, abs=0.005)
    assert any("positive to the right" in text for text in result.remarks)


def test_a_rate_limit_that_no_step_reaches_is_not_told():
    command, wheel = seen_by_imu(rover(b=0.01, lag=0.04, rate=50.0), (60.0,), np.random.default_rng(6))
    limit = by_wheel(command, wheel, 1.0).get("servo_rate_limit")
    assert limit is not None and not limit.determined and limit.low > 1.0


def test_a_wheel_that_does_not_follow_is_refused():
    command, wheel = seen_by_imu(PARAMETERS, STEPS, np.random.default_rng(7))
    noise = np.cumsum(np.random.default_rng(0).standard_normal(wheel.t.size)) * 1e-3
    with pytest.raises(DataRefused, match="does not follow"):
        by_wheel(command, Wheel(wheel.t, noise, False, 0.0), 1.0)


# ---- A bench's folder that was damaged, or written by hand: told in a sentence, and left as it is.

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


# ---- A bench on firmware 4.7 and later, whose ground station's id has another name.

COMMON = {
    "RC_OVERRIDE_TIME": 3.0,
    "SERVO1_FUNCTION": 26.0,
    **{
        f"SERVO1_{name}": value
        for name, value in (("TRIM", 1500), ("MIN", 1100), ("MAX", 1900), ("REVERSED", 0))
    },
    **{f"RC1_{name}": value for name, value in (("TRIM", 1500), ("MIN", 1100), ("MAX", 1900), ("DZ", 30))},
    "RC1_REVERSED": 0.0,
    "RC3_TRIM": 1500.0,
    "RC3_DZ": 30.0,
}


def test_the_new_name_is_asked_for_where_the_old_one_is_missing() -> None:
    assert {"MAV_GCS_SYSID", "MAV_GCS_SYSID_HI"} <= set(names_of(COMMON))
    assert "MAV_GCS_SYSID" not in names_of(COMMON | {"SYSID_MYGCS": 255.0})


def test_a_rover_of_4_7_is_benched_where_it_hears_us() -> None:
    assert steering_output(COMMON | {"MAV_GCS_SYSID": 255.0, "MAV_GCS_SYSID_HI": 0.0}).servo == 1
    with pytest.raises(UsageError, match="MAV_GCS_SYSID is 250"):
        steering_output(COMMON | {"MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 0.0})


def test_a_rover_that_tells_neither_name_is_refused() -> None:
    with pytest.raises(UsageError, match="did not report MAV_GCS_SYSID, MAV_GCS_SYSID_HI"):
        steering_output(COMMON)
