"""What a bench finds: from angles read by hand, from an IMU on the wheel, from a folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_servo import read_by_hand, rover, seen_by_imu, slope_by_hand

from rover_sweep.bench.bench_folder import (
    AngleReading,
    BenchFolder,
    BenchResult,
    interval,
    numbers_for_file,
    rate_limit,
    write_bench_numbers,
)
from rover_sweep.bench.by_wheel import Wheel, by_wheel
from rover_sweep.bench.evaluate import Readings, by_hand
from rover_sweep.bench.static_curve import curve
from rover_sweep.bench.steering_output import names_of, steering_output
from rover_sweep.cli.main import run
from rover_sweep.data.vehicle_file import load
from rover_sweep.errors import DataRefused, UsageError
from sitl.plant.effects.steering_effects import Linkage

BY_HAND = (50.0, 100.0, 200.0, 300.0)


def truth_is_held(
    draws: int, draw: Callable[[], BenchResult], truth: Mapping[str, float]
) -> dict[str, float]:
    """{number: share of the draws whose interval holds it}."""
    held = dict.fromkeys(truth, 0)
    for _ in range(draws):
        result = draw()
        for name, value in truth.items():
            number = result.get(name)
            assert number is not None
            held[name] += number.low <= value <= number.high
    return {name: count / draws for name, count in held.items()}


@pytest.mark.parametrize(("w", "draws"), [(0.0, 40), (0.012, 100)])
def test_intervals_hold_the_truth(w: float, draws: int):
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
    shares = truth_is_held(draws, lambda: by_hand(read_by_hand(parameters, BY_HAND, rng), 1500.0), truth)
    # 90 % intervals; at a true 0 a size that cannot be negative is held more often
    for name, share in shares.items():
        assert 0.8 <= share <= (1.0 if truth[name] == 0 else 0.98), shares


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


def test_a_servo_that_turns_left_and_angles_left_out_are_done_with():
    readings = read_by_hand(rover(b=0.01), BY_HAND, np.random.default_rng(1))
    some = readings.angle.copy()
    some[1::4] = np.nan
    for angle, true in ((-readings.angle, -0.00095), (some, 0.00095)):
        slope = by_hand(Readings(readings.pwm, angle, 1500.0), 1500.0).get("rad_per_us")
        assert slope is not None and slope.value == pytest.approx(true, rel=0.05)
    with pytest.raises(DataRefused, match="4 angles were read"):
        by_hand(Readings(readings.pwm[:4], readings.angle[:4], 1500.0), 1500.0)


def test_two_levels_tell_no_curve_and_say_so():
    result = by_hand(read_by_hand(rover(b=0.01), (80.0, 160.0), np.random.default_rng(2)), 1500.0)
    assert result.get("nonlinearity") is None and result.get("deadband") is None
    assert any("--steps" in text for text in result.untold)
    assert result.get("servo_lag") is None and any("servo_lag" in text for text in result.untold)


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


@pytest.mark.parametrize(("as_rate", "clock", "ahead"), [(False, 0.0, 0.0), (True, inf, 1.7e9)])
def test_all_that_is_there_is_found(as_rate: bool, clock: float, ahead: float):
    """Also by a gyro with a clock of its own, which leaves the delay untold."""
    command, wheel = seen_by_imu(PARAMETERS, STEPS, np.random.default_rng(3), as_rate, clock, ahead)
    result = by_wheel(command, wheel, 1.0)
    found = values(result)
    assert {name: found[name] for name in TRUTH} == pytest.approx(TRUTH, rel=0.06 if as_rate else 0.03)
    delay = result.get("servo_delay")
    if clock:
        assert delay is None and any("servo_delay" in text for text in result.untold)
    else:
        assert delay is not None and delay.low <= PARAMETERS.servo_delay <= delay.high
    assert result.get("trim_us") is None and any("trim_us" in text for text in result.untold)


def test_intervals_by_wheel_hold_the_truth():
    rng, truth = np.random.default_rng(8), {**TRUTH, "servo_delay": PARAMETERS.servo_delay}
    shares = truth_is_held(6, lambda: by_wheel(*seen_by_imu(PARAMETERS, (250.0,), rng), 1.0), truth)
    assert all(share >= 0.5 for share in shares.values()), shares  # 90 %: fewer than 3 of 6 once in 800 times
    assert sum(shares.values()) >= 0.8 * len(shares)


def test_an_imu_upside_down_is_turned_by_the_sign_in_the_vehicle_file():
    command, wheel = seen_by_imu(PARAMETERS, (250.0,), np.random.default_rng(5))
    result = by_wheel(command, Wheel(wheel.t, -wheel.value, False, 0.0), 1.0)
    assert values(result)["asymmetry"] == pytest.approx(0.05, abs=0.005)
    assert any("positive to the right" in text for text in result.remarks)
    noise = np.cumsum(np.random.default_rng(0).standard_normal(wheel.t.size)) * 1e-3
    with pytest.raises(DataRefused, match="does not follow"):
        by_wheel(command, Wheel(wheel.t, noise, False, 0.0), 1.0)


def test_a_rate_limit_that_no_step_reaches_is_not_told():
    command, wheel = seen_by_imu(rover(b=0.01, lag=0.04, rate=50.0), (60.0,), np.random.default_rng(6))
    limit = by_wheel(command, wheel, 1.0).get("servo_rate_limit")
    assert limit is not None and not limit.determined and limit.low > 1.0


# ---- What of a bench goes into the vehicle file, so that a steering angle made with it is the wheel's.


def result(**numbers: tuple[float, float]) -> BenchResult:
    """With these values and standard deviations."""
    keys = {n: "" if n == "rad_per_us" else f"steering.{n}" for n in numbers}
    found = [interval(n, "-", *x, 1.645, "", keys[n]) for n, x in numbers.items()]
    return BenchResult("made up", tuple(found), (), (), 0.0, 1)


def test_what_may_be_nothing_is_written_as_nothing_with_what_it_might_be():
    found = numbers_for_file(result(rad_per_us=(0.001, 1e-5), backlash=(0.01, 0.001), asymmetry=(0.01, 0.02)))
    assert found["steering.backlash"].value == 0.01
    assert found["steering.asymmetry"].value == 0.0
    assert found["steering.asymmetry"].sd == pytest.approx(np.hypot(0.01, 0.02), rel=0.1)


def test_a_slope_hardly_known_and_a_limit_that_nothing_reached_are_left_out():
    found = result(rad_per_us=(0.001, 2e-4), backlash=(0.01, 0.001))
    with_limit = BenchResult("", (*found.numbers, rate_limit(0.0, 0.1, 1.645)), (), (), 0.0, 1)
    assert set(numbers_for_file(with_limit)) == {"steering.backlash"}


@pytest.mark.parametrize(("c3", "w"), [(0.0, 0.0), (4.0, 0.0), (0.0, 0.02), (3.0, 0.01)])
def test_the_angles_of_the_file_are_those_of_the_wheel(vehicle_toml: Path, c3: float, w: float):
    """Within the accuracy of angles read to half a degree, whatever of curve and band was found."""
    made = rover(b=0.006, e=0.05, c3=c3, w=w)
    write_bench_numbers(vehicle_toml, by_hand(read_by_hand(made, BY_HAND, np.random.default_rng(2)), 1500.0))
    file = load(vehicle_toml)
    offset = np.linspace(-300, 300, 25)
    u = -(1500 + offset - file.trim_us.value) * file.rad_per_us.value
    mine = curve(u, file.asymmetry.value, file.nonlinearity.value, file.deadband.value)
    still = Linkage({k: v for k, v in made.effects.items() if k != "steering_backlash"})
    true = [still.wanted(-x * made.rad_per_us) for x in offset.tolist()]
    assert np.abs(mine - true).max() < np.radians(0.5)
    assert (file.nonlinearity.value != 0.0) == (c3 != 0.0 or file.deadband.value != 0.0)


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


DAMAGED: list[tuple[dict[str, Any], str]] = [
    ({"steering_output": None}, "steering_output is None, not an object"),
    ({"steering_output": {"servo": 1}}, "steering_output.trim is None, not a PWM of 500 to 2500 us"),
    *(
        ({"steering_output": OUTPUT | {"trim": trim}}, f"steering_output.trim is {trim!r}")
        for trim in (float("nan"), float("inf"), "1500", [1500])
    ),
    ({"steering_output": OUTPUT | {"servo": 1.5}}, "steering_output.servo is 1.5, not an output from 1 to"),
    ({"steering_output": OUTPUT | {"servo": True}}, "steering_output.servo is True"),
    ({"steering_output": OUTPUT | {"servo": 99}}, "steering_output.servo is 99"),
    ({"wheel": "imu.csv"}, "wheel is 'imu.csv', neither null nor an object"),
    ({"wheel": {"same_clock": "no"}}, "wheel.same_clock is 'no', neither true nor false"),
]


def test_what_no_bench_writes_is_named_and_left_as_it_is(
    folder: BenchFolder, vehicle_toml: Path, capsys: pytest.CaptureFixture[str]
):
    assert evaluated(folder, vehicle_toml) == 0
    path = folder.path / "bench.json"
    whole = path.read_text()
    for wrong, words in DAMAGED:
        path.write_text(json.dumps(json.loads(whole) | wrong))
        before = path.read_bytes()
        capsys.readouterr()
        assert evaluated(folder, vehicle_toml) == 3
        said = capsys.readouterr().err
        assert f"bench.json is damaged: {words}" in said and said.count("\n") == 1
        assert path.read_bytes() == before
    path.write_text(whole)
    readings = (folder.path / "readings.csv").read_bytes()
    for line, words in (
        (b"1.0,steps,nan,1500,0.1,\n", "it has nan as a time or PWM"),
        (b"1.0,steps,0,inf,0.1,\n", "it has inf as a time or PWM"),
        (b"1.0,steps,0,x,0.1,\n", "could not convert string to float: 'x'"),
        (b"\xff\xfe\n", "can't decode"),
    ):
        (folder.path / "readings.csv").write_bytes(readings + line)
        assert evaluated(folder, vehicle_toml) == 3
        assert "readings.csv is damaged: " in (said := capsys.readouterr().err) and words in said


# ---- A bench on firmware 4.7 and later, whose ground station's id has another name.

COMMON = {
    "RC_OVERRIDE_TIME": 3.0,
    "SERVO1_FUNCTION": 26.0,
    **{
        f"{which}_{name}": value
        for which in ("SERVO1", "RC1")
        for name, value in (("TRIM", 1500.0), ("MIN", 1100.0), ("MAX", 1900.0), ("REVERSED", 0.0))
    },
    "RC1_DZ": 30.0,
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
    with pytest.raises(UsageError, match="did not report MAV_GCS_SYSID, MAV_GCS_SYSID_HI"):
        steering_output(COMMON)
