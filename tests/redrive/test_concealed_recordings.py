"""The recordings with concealed effects: complete, readable, and equal in everything but the motion."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from rover_sweep.data.vehicle_file import load
from rover_sweep.logs.read import read_runs
from rover_sweep.logs.readers.dataflash import open_parts
from sitl.plant.effects_table import PARAMETERS

LETTERS = "abcdef"


@pytest.fixture(scope="module")
def folder(data: Path) -> Path:
    return data / "concealed-ardurover"


@pytest.mark.parametrize("letter", LETTERS)
def test_three_sweeps_and_a_doublet_at_two_amplitudes_and_speeds(folder: Path, letter: str) -> None:
    found = [read_runs(str(folder / letter / f"run{k}.BIN")) for k in (1, 2, 3, 4)]
    assert [len(runs) for runs in found] == [1, 1, 1, 1]
    small, large, slow, doublet = (runs[0] for runs in found)
    assert [r.kind for r in (small, large, slow, doublet)] == ["sweep"] * 3 + ["doublet"]
    assert [max(r.manoeuvre("pwm").x) - 1500 for r in (small, large)] == pytest.approx([120, 240], abs=2)
    assert slow.mean_speed < 0.7 * small.mean_speed
    assert all(r.standstill and r.straight for r in (small, large, slow, doublet))
    assert not [n.text for r in (small, large, slow, doublet) for n in r.notes if n.level == "warning"]


def test_size_settings_and_messages_do_not_tell_the_sets_apart(folder: Path) -> None:
    for k in (1, 2, 3, 4):
        paths = [folder / letter / f"run{k}.BIN" for letter in LETTERS]
        sizes = [path.stat().st_size for path in paths]
        assert max(sizes) < 1.02 * min(sizes)
        logs = [open_parts(path)[0] for path in paths]
        parameters = [
            set(zip(log.text("PARM", "Name"), log.rows("PARM")["Value"].tolist(), strict=True))
            for log in logs
        ]
        assert all(p == parameters[0] for p in parameters)
        kinds = [{name for name in log.formats if log.count(name)} for log in logs]
        assert all(kind == kinds[0] for kind in kinds)


def test_truth_names_effects_that_there_are_and_vehicle_files_err_a_little(data: Path, folder: Path) -> None:
    concealed = []
    for letter in LETTERS:
        truth = tomllib.loads((data / "concealed-ardurover-truth" / f"{letter}.toml").read_text())
        variant, measured = truth["variant"], load(folder / letter / "rover.toml")
        assert set(truth["concealed"]) <= set(variant["effects"]) & set(PARAMETERS)
        assert set(variant["effects"]) - set(truth["concealed"]) == {"sensor_filter"}
        assert measured.cg_to_front_axle.value == pytest.approx(variant["cg_to_front_axle"], abs=0.01)
        assert measured.rad_per_us is not None
        assert measured.rad_per_us.value == pytest.approx(variant["rad_per_us"], rel=0.03)
        concealed.append(tuple(truth["concealed"]))
    assert len(set(concealed)) == len(LETTERS) and () in concealed
