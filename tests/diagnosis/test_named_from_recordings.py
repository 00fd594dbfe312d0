"""Recordings of the real firmware that conceal an effect: the diagnosis finds it."""

import json
import tomllib
from pathlib import Path

import pytest

from rover_sweep.cli.main import run

DATA = Path(__file__).parents[1] / "data"
SETS = DATA / "concealed-ardurover"
TRUTH = DATA / "concealed-ardurover-truth"


@pytest.mark.parametrize("name", ["a", *(pytest.param(n, marks=pytest.mark.slow) for n in "cf")])
def test_the_concealed_effect_is_named_and_pays_on_the_fresh_run(name, tmp_path):
    folder = SETS / name
    runs = [str(folder / f"run{k}.BIN") for k in (1, 2, 3)]
    out = tmp_path / "out"
    fresh, rover = str(folder / "run4.BIN"), str(folder / "rover.toml")
    assert run(["diagnose", *runs, "--hold-out", fresh, "--vehicle", rover, "--out", str(out)]) == 0
    answer = json.loads((out / "diagnosis.json").read_text())
    hidden = tomllib.loads((TRUTH / f"{name}.toml").read_text())["concealed"]
    assert [f["effect"] for f in answer["findings"]] == hidden
    assert answer["verdict"] == ("explained" if hidden else "none")
    for finding in answer["findings"]:
        assert finding["held_out"]["share_removed"] > 0.4
        assert finding["look_alikes"] == []


@pytest.mark.slow
def test_a_kinematic_simulation_lacks_tyres_and_roll(tmp_path):
    """ArduPilot's own rover as the simulation, a rover with tyres and springs as the recording."""
    nominal, out = DATA / "ardurover-4.6.3" / "nominal", tmp_path / "out"
    runs = [str(nominal / f"run{k}.BIN") for k in (1, 2, 3)]
    simulation = str(DATA / "ardurover-4.6.3" / "stock" / "run1.BIN")
    code = run(
        [
            "diagnose",
            *runs,
            "--simulation",
            simulation,
            "--hold-out",
            str(nominal / "run4.BIN"),
            "--vehicle",
            str(DATA / "rover.toml"),
            "--out",
            str(out),
        ]
    )
    answer = json.loads((out / "diagnosis.json").read_text())
    found = {f["effect"]: f for f in answer["findings"]}
    assert code == 0 and set(found) == {"tyre_slip", "roll_dof"}
    assert found["roll_dof"]["parameters"]["k_phi"]["value"] == pytest.approx(10.8, rel=0.08)
    assert found["tyre_slip"]["parameters"]["Izz"]["value"] == pytest.approx(0.071, rel=0.08)
    assert answer["held_out"][0]["share_removed"] > 0.7  # both together; each alone leaves the other's error
