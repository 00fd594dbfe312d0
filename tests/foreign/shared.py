"""Recorded rovers whose truth is known: a folder with cNN.json and cNN.tar.xz of run1.BIN to run4.BIN."""

from __future__ import annotations

import json
import tarfile
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import rover_sweep as rs
from tests.foreign.answer import answered
from tests.foreign.grade import Graded, grade

# {key of "hidden": effect id}; keys that only belong to another one are left out
IDS = {
    "surface_t": "surface_change",
    "servo_rate": "servo_rate_limit",
    "brush": "tyre_saturation",
    "mu": "tyre_saturation",
    "roll_steer": "roll_steer",
    "unbalance": "outside:wheel_unbalance",
    "front_ratio": "front_rear_stiffness",
    "cubic": "steering_nonlinearity",
    "gyro_lp": "sensor_filter",
    "stiction": "steering_stiction",
    "diff": "yaw_damping",
    "bank": "cross_slope",
    "dry_roll": "suspension_friction",
    "vel_lag": "velocity_lag",
    "imu_x": "imu_offset",
    "locked_rear": "yaw_damping",
    "rear_soft": "front_rear_stiffness",
    "play": "steering_backlash",
    "mast": "outside:flexing_mast",
    "slip_speed": "outside:slip_speed",
    "pendulum": "outside:pendulum",
}
PARTS = ("surface_k", "pendulum_hz")


def hidden_ids(hidden: Mapping[str, float]) -> tuple[str, ...]:
    """Effect ids of what a case hides; KeyError for an unknown key."""
    return tuple(IDS[key] for key in hidden if key not in PARTS)


def cases(folder: Path, only: str = "") -> tuple[Path, ...]:
    """The .json of each case that has its recordings; only: names, separated by commas."""
    wanted = set(only.split(",")) if only else None
    found = sorted(p for p in folder.glob("*.json") if p.with_suffix(".tar.xz").exists())
    return tuple(p for p in found if wanted is None or p.stem in wanted)


def diagnosed_cases(
    folder: Path, only: str = "", **settings: Any
) -> Iterator[tuple[Graded, dict[str, Any], str]]:
    """(marks, answer, truth in words) of each case: runs 1 to 3 are fitted, run 4 is held out."""
    for path in cases(folder, only):
        case = json.loads(path.read_text())
        with tempfile.TemporaryDirectory() as unpacked:
            with tarfile.open(path.with_suffix(".tar.xz")) as archive:
                archive.extractall(unpacked, filter="data")
            vehicle = Path(unpacked) / "rover.toml"
            vehicle.write_text(vehicle_text(case["told"], above_roll_axis="engine" in case))
            logs = [next(Path(unpacked).rglob(f"run{k}.BIN")) for k in (1, 2, 3, 4)]
            runs = rs.read(*logs[:3], vehicle=vehicle)
            found = answered(runs, rs.read(logs[3], vehicle=vehicle), **settings)
        hidden = hidden_ids(case["hidden"])
        truth = ", ".join(f"{key} {value:.3g}" for key, value in case["hidden"].items()) or "none"
        yield grade(path.stem, "recorded", hidden, found), found, truth


def vehicle_text(told: Mapping[str, float], above_roll_axis: bool = False) -> str:
    """The vehicle file (TOML) of what the owner knows.

    imu_z [m]: below the CG. above_roll_axis: imu_z is the height over the roll axis, as in the cases that
    name an engine.
    """
    own = ("rad_per_us", "imu_z")
    down = told.get("imu_z", 0.06)
    if above_roll_axis:
        down = told["cg_height_above_roll_centre"] - down
    lines = ["[vehicle]", *(f"{key} = {value!r}" for key, value in told.items() if key not in own)]
    lines += ["[steering]", "trim_us = 1500", f"rad_per_us = {told['rad_per_us']!r}"]
    return "\n".join([*lines, "[imu]", f"position = [0.0, 0.0, {down!r}]", ""])
