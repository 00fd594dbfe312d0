"""Columns are chosen together, by how well they explain each other; names only shift the odds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rover_sweep.data.recording import Array
from rover_sweep.logs.readers.guessed_columns import ColumnGuess, guess_columns
from rover_sweep.logs.readers.tables import read_table
from tests.logs.test_foreign_files import drive, written

D = drive()
NOISE = np.random.default_rng(7).standard_normal((4, D["t"].size))


def guessed(folder: Path, columns: Mapping[str, Array]) -> ColumnGuess:
    return guess_columns(read_table([written(folder / "log.csv", columns)]))


def named(entry: Any) -> str:
    return str(entry["column"]) if isinstance(entry, dict) else str(entry)


def late(x: Array, steps: int) -> Array:
    return np.concatenate((np.full(steps, x[0]), x[:-steps]))


MOTION = {
    "Time [s]": D["t"],
    "Car.YawRate [rad/s]": D["r"],
    "Car.vx [m/s]": D["v"],
    "Car.ay [m/s^2]": D["ay"],
}
# a rear axle gives way to the side force, which is late
REAR = {f"Car.SteerAngleR{side} [rad]": sign * 3e-3 - 4e-4 * D["ay"] for side, sign in (("L", -1), ("R", 1))}


def test_a_rear_wheel_is_not_taken_for_the_steering(tmp_path: Path) -> None:
    front = {f"Car.SteerAngleF{side} [rad]": k * D["delta"] for side, k in (("L", 1.01), ("R", 0.99))}
    found = guessed(tmp_path, {**REAR, **front, **MOTION})
    assert named(found.map["delta"]).startswith("Car.SteerAngleF")
    other = "FR" if "FL" in named(found.map["delta"]) else "FL"
    assert f'# delta = "Car.SteerAngle{other} [rad]"  # fits alike' in found.text()
    assert '# delta = "Car.SteerAngleR' not in found.text()


def test_a_column_that_fits_far_better_overrules_a_name(tmp_path: Path) -> None:
    found = guessed(tmp_path, {**REAR, "Sensor.SAngle.Ang [rad]": D["delta"], **MOTION})
    assert named(found.map["delta"]) == "Sensor.SAngle.Ang [rad]"


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_name_decides_between_columns_that_fit_alike(share: float, tmp_path: Path) -> None:
    mixed = D["delta"] + share * float(np.std(D["delta"])) * NOISE[0]
    for other in ("Signal_7", "aux"):
        found = guessed(
            tmp_path, {"t": D["t"], other: mixed, "steering": mixed, "gyro_z": D["r"], "v": D["v"]}
        )
        assert named(found.map["delta"]) == "steering"


def test_a_quaternion_is_no_yaw_rate(tmp_path: Path) -> None:
    parts = {"x": 0 * D["t"], "y": 0 * D["t"], "z": np.sin(D["psi"] / 2), "w": np.cos(D["psi"] / 2)}
    columns = {"t": D["t"], **parts, "Signal_3": D["r"], "steering": D["delta"], "speed": D["v"]}
    found = guessed(tmp_path, columns)
    assert named(found.map["r"]) == "Signal_3" and named(found.map["delta"]) == "steering"


def test_yaw_and_roll_rate_with_each_others_names_are_found(tmp_path: Path) -> None:
    roll = 0.05 * np.gradient(D["ay"], D["t"]) + 0.02 * NOISE[1]
    columns = {"t": D["t"], "steering": D["delta"], "speed": D["v"], "ay": D["ay"]}
    found = guessed(tmp_path, {**columns, "yaw_rate": roll, "roll_rate": D["r"]})
    assert named(found.map["r"]) == "roll_rate"


def test_columns_without_any_name_are_found_by_what_holds_between_them(tmp_path: Path) -> None:
    signals = (D["ay"], D["delta"], NOISE[2], D["v"], D["r"])
    found = guessed(tmp_path, {"t": D["t"]} | {f"Signal_{n}": x for n, x in enumerate(signals)})
    wanted = {"ay": "Signal_0", "delta": "Signal_1", "speed": "Signal_3", "r": "Signal_4"}
    assert {channel: named(found.map.get(channel)) for channel in wanted} == wanted


def test_a_set_yaw_rate_is_not_taken_for_the_measured_one(tmp_path: Path) -> None:
    set_rate = D["v"] / 0.33 * D["delta"]  # follows the steering without any lag
    columns = {"t": D["t"], "steering": D["delta"], "speed": D["v"], "cmd_yaw_rate": set_rate}
    assert named(guessed(tmp_path, {**columns, "yaw_rate": D["r"]}).map["r"]) == "yaw_rate"


def test_two_yaw_rates_that_fit_alike_are_both_shown(tmp_path: Path) -> None:
    gyros = {f"gyro{n}_z": D["r"] + 0.02 * NOISE[n] for n in (1, 2)}
    found = guessed(tmp_path, {"t": D["t"], "steering": D["delta"], "speed": D["v"], **gyros})
    other = {"gyro1_z": "gyro2_z", "gyro2_z": "gyro1_z"}[named(found.map["r"])]
    assert f'# r = "{other}"  # fits alike' in found.text()
    assert named(found.map["delta"]) == "steering"


def test_a_command_and_its_measurement_give_no_yaw_rate(tmp_path: Path) -> None:
    measured = late(D["delta"], 3) + 0.001 * NOISE[3]
    columns = {"t": D["t"], "steer_cmd": D["delta"], "steer_measured": measured, "speed": D["v"]}
    found = guessed(tmp_path, columns)
    assert found.missing == ("yaw rate",) and "r" not in found.map
    assert named(found.map["speed"]) == "speed" and named(found.map["delta"]).startswith("steer_")


@pytest.mark.parametrize("name", ["Signal_{}", "acc_{}_y", "yaw_{}"])
def test_chance_among_many_columns_does_not_overrule_names(name: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    walks = np.cumsum(rng.standard_normal((36, D["t"].size)), axis=1)
    named_ones = {"t": D["t"], "steering": D["delta"], "speed": D["v"], "yaw_rate": D["r"]}
    found = guessed(tmp_path, named_ones | {name.format(n): x for n, x in enumerate(walks)}).map
    wanted = {"delta": "steering", "speed": "speed", "r": "yaw_rate"}
    assert {channel: named(found[channel]) for channel in wanted} == wanted


def test_the_other_axes_of_a_phones_gyro_are_no_yaw_rates(tmp_path: Path) -> None:
    axes = {"x": 0.01 * NOISE[0], "y": 0.01 * NOISE[1], "z": D["r"]}
    gyro = {f"Gyroscope {axis} (rad/s)": x for axis, x in axes.items()}
    found = guessed(tmp_path, {"Time (s)": D["t"], **gyro, "speed": D["v"]})
    assert found.map["r"] == "Gyroscope z (rad/s)" and "fits alike" not in found.text()
