"""Steering at its end stops is known as such, by its stays at one angle or by the vehicle file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rover_sweep as rs

MAP = {"time": "t", "delta": "steer", "r": "r", "speed": "v"}
STOP = 0.34  # rad
ROVER = "[vehicle]\nmass = 3.0\ncg_to_front_axle = 0.16\ncg_to_rear_axle = 0.16\n"


def drive(tmp_path: Path, largest: float, recorded: float) -> str:
    """30 s by hand: commands up to `largest` [rad], recorded up to `recorded`; the wheels stop at `STOP`."""
    random = np.random.default_rng(2)
    t = np.arange(0, 30, 0.02)
    knots = np.cumsum(random.uniform(0.3, 0.9, 120))
    command = np.interp(t, knots, largest * random.uniform(-1, 1, knots.size))
    r = 2.0 * np.clip(command, -STOP, STOP) / 0.32
    steer = np.clip(command, -recorded, recorded)
    rows = np.column_stack((t, steer, r + 0.01 * random.standard_normal(t.size), np.full(t.size, 2.0)))
    path = tmp_path / "drive.csv"
    path.write_text("t,steer,r,v\n" + "\n".join(",".join(f"{x:.6g}" for x in row) for row in rows))
    return str(path)


def test_stays_at_equal_angles_are_the_stops(tmp_path: Path) -> None:
    (run,) = rs.read(drive(tmp_path, 0.5, STOP), columns=MAP)
    (note,) = (n for n in run.notes if "end stops" in n.text)
    assert "at 0.34 rad to either side" in note.text and note.level == "warning"


def test_steering_below_the_stops_gets_no_note(tmp_path: Path) -> None:
    (run,) = rs.read(drive(tmp_path, 0.3, 1.0), columns=MAP)
    assert not any("stop" in n.text for n in run.notes)


def test_the_wheels_stop_at_the_angle_of_the_vehicle_file(tmp_path: Path) -> None:
    source = drive(tmp_path, 0.5, 1.0)
    (tmp_path / "bare.toml").write_text(ROVER)
    (tmp_path / "rover.toml").write_text(ROVER + f"max_steering_angle = {STOP}\n")
    bare, known = (rs.read(source, columns=MAP, vehicle=tmp_path / f"{n}.toml") for n in ("bare", "rover"))
    assert np.max(np.abs(known[0]["delta"].x)) == pytest.approx(STOP)
    assert any("beyond max_steering_angle, 0.34 rad" in n.text for n in known[0].notes)
    wrong, right = (
        rs.identify(runs, bootstrap=0, models=["bicycle"]).models["kinematic"].fit["L_eff"].value
        for runs in (bare, known)
    )
    assert right == pytest.approx(0.32, rel=0.02) and wrong > 1.05 * right
