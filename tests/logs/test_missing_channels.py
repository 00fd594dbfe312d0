"""What a file of another system lacks is asked for, and what it has is found all the same."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import rover_sweep as rs
from rover_sweep.cli.main import cli
from rover_sweep.data.recording import Array
from rover_sweep.errors import UsageError
from rover_sweep.logs.read import read_logs
from rover_sweep.logs.readers.guessed_columns import ColumnGuess, guess_columns
from rover_sweep.logs.readers.tables import read_table
from tests.logs.test_foreign_files import WHEELBASE, drive, written


def guessed(*paths: Path, rate: float = 0.0) -> ColumnGuess:
    return guess_columns(read_table(paths), rate)


def without_clock(folder: Path, **more: Array) -> Path:
    d = drive(100.0)
    return written(folder / "drive.csv", {"steering": d["delta"], "yaw_rate": d["r"], "speed": d["v"]} | more)


def test_a_missing_clock_is_asked_for(tmp_path: Path) -> None:
    path = without_clock(tmp_path)
    found = guessed(path)
    assert found.missing == ("time",) and {"delta", "r", "speed"} <= set(found.map)
    with pytest.raises(UsageError, match=r"has no clock: .* with --rate HZ"):
        rs.identify_driving(path)
    answer = rs.identify_driving(path, columns={"time": {"rate": 100}})
    assert answer.numbers["wheelbase_seen"].value == pytest.approx(WHEELBASE, rel=0.05)
    shown = CliRunner().invoke(cli, ["identify", str(path), "--rate", "100", "--out", str(tmp_path / "out")])
    assert shown.exit_code == 0 and "time = {rate = 100.0}" in " ".join(shown.output.split())


def test_what_a_file_suggests_as_its_rate_is_only_a_comment(tmp_path: Path) -> None:
    path = without_clock(tmp_path, yaw=drive(100.0)["psi"])
    found = guessed(path)
    assert found.missing == ("time",) and "time" not in tomllib.loads(found.text())
    assert "# time = {rate = 100}  # Hz, a guess" in found.text()


def test_a_spiky_gyro_gives_no_rate_that_the_positions_contradict(tmp_path: Path) -> None:
    d = drive(100.0)
    more = {"yaw": 1.7 * d["psi"], "x": d["x"], "y": d["y"]}
    found = guessed(without_clock(tmp_path, **more))
    assert "two guesses that disagree" in found.text() and "time" not in found.map
    assert "at 59 Hz" in found.text() and "at 100 Hz" in found.text()


def test_speed_and_steering_are_found_without_a_yaw_rate(tmp_path: Path) -> None:
    d = drive()
    names = {"t": d["t"], "vehicle_speed_status": d["v"], "steer_angle_status": np.degrees(d["delta"])}
    found = guessed(written(tmp_path / "bus.csv", names))
    assert found.missing == ("yaw rate",)
    assert found.map["speed"] == "vehicle_speed_status"
    assert found.map["delta"]["column"] == "steer_angle_status"


def test_the_name_of_a_file_does_not_hide_its_columns_and_may_be_their_only_name(tmp_path: Path) -> None:
    d = drive()
    steer = written(tmp_path / "ros_steer.csv", {"t": d["t"], "angle": d["delta"], "speed": d["v"]})
    imu = written(tmp_path / "ros_imu.csv", {"t": d["t"], "yaw_rate": d["r"], "ay": d["ay"]})
    found = guessed(steer, imu)
    assert found.map["speed"] == "ros_steer.speed" and found.map["delta"] == "ros_steer.angle"
    parts = {"steering": d["delta"], "speed": d["v"], "yaw_rate": d["r"]}
    single = [written(tmp_path / f"{n}.csv", {"time": d["t"], "value": x}) for n, x in parts.items()]
    found = guessed(*single)
    named = {"delta": "steering.value", "speed": "speed.value", "r": "yaw_rate.value"}
    assert {
        k: v["column"] if isinstance(v, dict) else v for k, v in found.map.items() if k != "time"
    } == named


@pytest.mark.parametrize("change", [0.0, 0.5])
def test_a_constant_is_proposed_only_for_a_speed_that_stayed_the_same(change: float, tmp_path: Path) -> None:
    t = drive()["t"]
    v = 8.0 + 8 * change * np.sin(0.21 * t)
    delta = 0.02 * np.sin(0.9 * t) + 0.01 * np.sin(4.7 * t)
    r = v / 2.5 * delta
    path = written(tmp_path / "car.csv", {"t": t, "steering": delta, "yaw_rate": r, "ay": v * r})
    text = guessed(path).text()
    assert ("# speed = 8  # m/s^2" in text) == (change == 0)
    assert ("says that it varied" in text) == (change > 0)
    assert "its unit is undecided: m/s^2 or ft/s^2" in text and "ay" not in guessed(path).map


def test_the_unit_of_an_acceleration_is_that_in_which_it_is_v_r(tmp_path: Path) -> None:
    d = drive()
    for factor, unit in ((1.0, "m/s^2"), (1 / 0.3048, "ft/s^2")):
        columns: dict[str, Any] = {"t": d["t"], "steering": d["delta"], "yaw_rate (rad/s)": d["r"]}
        columns |= {"speed (m/s)": d["v"], "lat_acc": factor * d["ay"]}
        found = guessed(written(tmp_path / "car.csv", columns)).map["ay"]
        assert (found if unit == "m/s^2" else found["unit"]) == ("lat_acc" if unit == "m/s^2" else unit)


def test_stamps_of_the_measurement_are_used_before_the_time_of_the_export(tmp_path: Path) -> None:
    d = drive()
    nanoseconds = (1_400_000_000 + d["t"]) * 1e9

    def topic(name: str, late: float, **columns: Array) -> Path:
        stamps = {"%time": nanoseconds + (1e6 + late) * 1e9, "field.header.stamp": nanoseconds}
        return written(tmp_path / f"{name}.csv", {n: x.astype(int) for n, x in stamps.items()} | columns)

    files = (
        topic("a", 0.0, **{"field.steering_angle": d["delta"], "field.speed": d["v"]}),
        topic("b", 37.0, **{"field.angular_velocity.z": d["r"]}),
    )
    assert [c["column"] for c in guessed(*files).map["time"]] == [
        "a.field.header.stamp",
        "b.field.header.stamp",
    ]
    (log,) = read_logs("+".join(map(str, files)))
    assert log.signals["r"].t[0] == pytest.approx(log.signals["speed"].t[0], abs=0.1)
