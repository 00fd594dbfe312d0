"""Derivatives as the baseline: effects of steering and sensors are found, and they hold at any speed."""

import json
from pathlib import Path

import numpy as np
import pytest
from planted import sweeps

from rover_sweep.cli.main import run
from rover_sweep.data.geometry import Geometry, Tolerances
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.simulation import candidates as lumped_baseline
from rover_sweep.diagnosis.simulation.candidates import DEGREES_OF_FREEDOM, Model, added_coordinates
from rover_sweep.diagnosis.simulation.simulator import logged, vehicle_numbers
from rover_sweep.diagnosis.simulation.single_track import single_tracks

SET = Path(__file__).parents[1] / "data" / "concealed-ardurover" / "d"
BESIDE_DERIVATIVES = [
    e.id for e in library().values() if "lumped" in e.baselines and e.id not in DEGREES_OF_FREEDOM
]
ROVER = Geometry(2.76, 0.196, 0.187, 2.49, 0.058, 0.0146, 0.075)


@pytest.mark.slow
def test_a_trim_and_a_rate_limit_are_named_beside_derivatives(tmp_path: Path) -> None:
    runs = [str(SET / f"run{k}.BIN") for k in (1, 2, 3)]
    out = tmp_path / "out"
    code = run(
        [
            "diagnose",
            *runs,
            "--hold-out",
            str(SET / "run4.BIN"),
            "--baseline",
            "lumped",
            "--vehicle",
            str(SET / "rover.toml"),
            "--out",
            str(out),
        ]
    )
    answer = json.loads((out / "diagnosis.json").read_text())
    assert code == 0 and answer["baseline"] == "lumped"
    assert {f["effect"] for f in answer["findings"]} == {"steering_trim", "servo_rate_limit"}
    assert answer["held_out"][0]["share_removed"] > 0.7
    assert {"tyre_slip", "roll_dof", "imu_tilt"} <= {u["effect"] for u in answer["cannot_see"]}


@pytest.mark.parametrize("roll", [True, False])
def test_the_first_derivatives_move_as_the_model_that_they_are_made_of_at_any_speed(roll: bool) -> None:
    """Small angles: the linear derivatives against the single track with its own first numbers."""
    t = np.arange(0, 4, 0.005)
    steer, speed, zero = 0.01 * np.sin(2 * t**2), 1.5 + 0.3 * t, np.zeros(t.size)
    stiffness = 1.5 * ROVER.mass * 9.81
    about = 0.0146 + 2.49 * 0.058**2
    k_phi = about * (2 * np.pi * 3.5) ** 2 + 2.49 * 9.81 * 0.058
    x = {
        "ln_C": np.log(stiffness),
        "ln_Izz": np.log(0.075),
        "ln_k_phi": np.log(k_phi),
        "ln_b_phi": np.log(0.4 * about * 2 * np.pi * 3.5),
    }
    q = np.array(vehicle_numbers(Model("roll-yaw" if roll else "bicycle", ROVER, Tolerances()), x))
    drive = (steer, speed, np.ones(t.size), zero, zero, zero, q)
    whole = single_tracks(drive, drive, (False, False), roll, 0.005)[0]
    first = {c.name: c.start for c in lumped_baseline.derivatives(ROVER, roll)}
    found = lumped_baseline.motion(steer, speed, zero, first, 0.005)
    for k, name in enumerate(("v", "r", "phi", "p", "across")):
        assert np.max(np.abs(found[name] - whole[k])) <= 0.005 * np.max(np.abs(whole[k])) + 1e-12, name


@pytest.mark.parametrize("effect", BESIDE_DERIVATIVES)
def test_every_effect_that_may_act_beside_derivatives_can_be_simulated(effect: str) -> None:
    """A slope looked for the sprung mass's moment, which the derivatives do not have."""
    run = sweeps(1)[0]
    model = Model("lumped", ROVER, Tolerances())
    whole = model.with_effect(effect, run.name)
    x = {c.name: c.start for c in whole.free} | {
        c.name: 0.25 * c.scale for c in added_coordinates(whole.law(effect))
    }
    found = logged(run, whole, x)
    assert found and all(np.all(np.isfinite(y)) for y in found.values())
