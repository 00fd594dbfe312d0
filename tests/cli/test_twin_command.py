"""`twin` and `diagnose --simulation` from the command line."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import rover_sweep as rs
from rover_sweep.cli.driving import shown_results
from rover_sweep.diagnosis.result import Diagnosis
from sitl.plant.variant import load_variant
from tests.comparison.pairs import RECORDED, drive, vehicle_file
from tests.comparison.test_compared_physics import baseline_model

ROVER = replace(load_variant("nominal"), friction=1.5, yaw_inertia=0.09)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """(recording, vehicle file) of a rover whose yaw inertia the nominal one does not have."""
    folder = tmp_path_factory.mktemp("twin")
    (path,) = drive(ROVER, [RECORDED / "run1.BIN"], folder / "recorded", 21)
    vehicle = folder / "rover.toml"
    whole = vehicle_file(ROVER, np.random.default_rng(3))
    lines = [line for line in whole.splitlines() if not line.startswith("yaw_inertia")]
    vehicle.write_text("\n".join(lines), encoding="utf-8")
    return path, vehicle


def test_twin_corrects_and_writes_everything(run_program, drawn, tmp_path, monkeypatch):
    path, vehicle = drawn
    model = baseline_model(rs.read(str(path), vehicle=vehicle))
    found = Diagnosis("none", "no effect is missing", "roll-yaw", model=model)
    monkeypatch.setattr(shown_results, "diagnosis_of", lambda *ignored: found)
    done = run_program(
        "twin", str(path), "--vehicle", str(vehicle), "--out", str(tmp_path / "twin"), "--json"
    )
    assert done.code == 0, done.err
    answer = json.loads(done.out)
    assert answer["format"] == "rover-sweep twin"
    assert answer["agrees"], answer["sentence"]
    assert "yaw_inertia" in {c["entry"] for c in answer["corrections"]}
    assert len(answer["rounds"]) >= 2
    rover = load_variant(tmp_path / "twin" / "variant.toml")
    assert rover.yaw_inertia == pytest.approx(ROVER.yaw_inertia, rel=0.08)
    assert (tmp_path / "twin" / "twin.html").is_file()
    assert (tmp_path / "twin" / "simulated" / "drive1" / "sim1.BIN").is_file()
    assert "TWIN AGREES" in done.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--vehicle", "embedded"), "there is no vehicle file embedded"),
        (("--vehicle", "no.toml"), "no.toml"),
        (("--variant", "no-such"), "no variant no-such"),
    ],
)
def test_twin_says_what_is_wrong(run_program, drawn, tmp_path, arguments, words):
    path, vehicle = drawn
    given = arguments if "--vehicle" in arguments else (*arguments, "--vehicle", str(vehicle))
    done = run_program("twin", str(path), *given, "--out", str(tmp_path / "twin"))
    assert done.code == 2
    assert words in done.err
    assert not (tmp_path / "twin").exists()


def test_a_table_without_pwm_is_refused_at_once(run_program, drawn, tmp_path):
    """The simulated rover repeats a steering output, so a table of angles cannot be driven again."""
    t = np.arange(0.0, 40.0, 0.01)
    delta = 0.1 * np.sin(2 * np.pi * (0.2 + 0.03 * t) * t)
    table = np.column_stack((t, delta, np.full(t.size, 2.0), 5.0 * delta))
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="t,d,V,r", comments="")
    columns = 'time = "t"\ndelta = "d"\nspeed = "V"\nr = "r"\n'
    (tmp_path / "a.toml").write_text(columns)
    where = (
        "--columns",
        str(tmp_path / "a.toml"),
        "--vehicle",
        str(drawn[1]),
        "--out",
        str(tmp_path / "twin"),
    )
    done = run_program("twin", str(tmp_path / "a.csv"), *where)
    assert done.code == 3
    assert "no steering output in us was recorded" in done.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("--simulation", "sim1.BIN", "--simulator", "plant"),
            "--simulator and --simulation are alternatives",
        ),
        (("--variant", "nominal"), "--variant nominal needs --simulator"),
    ],
)
def test_diagnose_says_what_is_wrong_with_the_simulation(run_program, drawn, tmp_path, arguments, words):
    path, vehicle = drawn
    out = ("--out", str(tmp_path / "report"))
    done = run_program("diagnose", str(path), "--vehicle", str(vehicle), *arguments, *out)
    assert done.code == 2
    assert words in done.err


def test_serve_needs_a_variant(run_program, tmp_path):
    done = run_program("twin", "serve", str(tmp_path))
    assert done.code == 2
    assert "has no variant.toml" in done.err


def test_serve_without_the_firmware_says_how(run_program, tmp_path):
    (tmp_path / "variant.toml").write_text('base = "nominal"\n')
    done = run_program("twin", "serve", str(tmp_path), "--ardurover", str(tmp_path / "none"))
    assert done.code == 4
    assert "--physics serves the JSON interface alone" in done.err
