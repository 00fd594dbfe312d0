"""From recordings of the real firmware to a rover that is simulated with what was found in them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from augmented_models import on_smooth_ground

import rover_sweep as rs
from rover_sweep.cli.main import run

SET = Path(__file__).parents[1] / "data" / "concealed-ardurover" / "c"
VEHICLE = SET / "rover.toml"
RUN4 = str(SET / "run4.BIN")


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a diagnosis of a large sweep and one at a second speed; run 4 plays no part in the fit."""
    out = tmp_path_factory.mktemp("diagnosed") / "out"
    runs = [str(SET / "run1.BIN"), str(SET / "run3.BIN")]
    words = ["--hold-out", RUN4, "--vehicle", str(VEHICLE), "--only", "tyre_relaxation,steering_backlash"]
    assert run(["diagnose", *runs, *words, "--out", str(out)]) == 0
    return out


def errors(recording: Path) -> dict[str, float]:
    """RMS of what was measured in run 4 less what stands in a recording of a simulation of it."""
    (measured,) = rs.read(RUN4)
    (simulated,) = rs.read(recording)
    found = {}
    for channel in ("r", "ay"):
        real = measured.manoeuvre(channel)
        found[channel] = float(np.sqrt(np.mean((simulated[channel].on(real.t) - real.x) ** 2)))
    return found


# {ground: largest error of the diagnosed rover over that of the nominal one}; measured .31 and .68 on the
# nominal rover's ground, of which neither drive knows the other's, and .22 and .53 on smooth ground
ROOM = {"rough": {"r": 0.45, "ay": 0.80}, "smooth": {"r": 0.35, "ay": 0.65}}


@pytest.mark.parametrize("ground", ROOM)
def test_the_diagnosed_rover_drives_run_4_as_it_was_and_the_nominal_does_not(
    ground: str, diagnosed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    variant = diagnosed / "variant.toml"
    if ground == "smooth":
        variant = on_smooth_ground(variant.read_text(), tmp_path)
    nominal = "nominal" if ground == "rough" else str(tmp_path / "smooth.toml")
    variants = {
        "nominal": [nominal],
        "with its lengths and masses": [nominal, "--vehicle", str(VEHICLE)],
        "diagnosed": [str(variant)],
    }
    found = {}
    for name, words in variants.items():
        out = tmp_path / f"{name}.BIN"
        assert run(["redrive", RUN4, "--simulator", "plant", "--variant", *words, "--out", str(out)]) == 0
        found[name] = errors(out)
    with capsys.disabled():
        print(
            "",
            *(f"{ground}, {n}: r {e['r']:.4f} rad/s, a_y {e['ay']:.3f} m/s^2" for n, e in found.items()),
            sep="\n",
        )
    for channel, room in ROOM[ground].items():
        assert found["diagnosed"][channel] < room * min(
            e[channel] for n, e in found.items() if n != "diagnosed"
        )


def test_a_diagnosis_is_read_back_from_its_report_and_simulates(diagnosed: Path) -> None:
    found = rs.load_diagnosis(diagnosed / "diagnosis.json")
    (fresh,) = rs.read(RUN4, vehicle=VEHICLE)
    again = rs.simulate(found, fresh)
    document = json.loads((diagnosed / "diagnosis.json").read_text())
    assert [f.effect for f in found.findings] == ["tyre_relaxation"] == document["model"]["effects"]
    without = rs.simulate(plain(found), fresh)
    assert again.error("r") < 0.35 * without.error("r")
    assert "tyre_relaxation" in repr(found) and rs.load_diagnosis(diagnosed).sentence == found.sentence


def plain(found: rs.FullDiagnosis) -> rs.FullDiagnosis:
    """The same numbers without the effect."""
    from dataclasses import replace

    assert found.model is not None
    return replace(found, model=replace(found.model, effects=()))


def test_export_writes_every_form(
    diagnosed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("model.m", "model.py", "model.mat", "model.json"):
        assert run(["export", str(diagnosed), "-o", str(tmp_path / name)]) == 0
    exported = json.loads((tmp_path / "model.json").read_text())
    assert exported["model"] == "roll-yaw with tyre_relaxation" and {"F_f", "F_r"} <= set(exported["states"])
    capsys.readouterr()
    assert run(["export", str(diagnosed / "diagnosis.json"), "--speed", "3"]) == 0
    assert json.loads(capsys.readouterr().out)["speed_m_s"] == 3.0
    assert run(["export", str(diagnosed), "--plant"]) == 0
    assert capsys.readouterr().out == (diagnosed / "variant.toml").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--plant", "-o", "x.json"], "a simulated rover is a TOML file"),
        (["--plant", "--speed", "3"], "--plant always writes TOML"),
        (["--model", "bicycle"], "has only the model"),
    ],
)
def test_export_says_what_is_wrong(
    diagnosed: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["export", str(diagnosed), *words]) == 2
    assert said in capsys.readouterr().err


def test_a_plant_takes_a_diagnosis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["export", str(tmp_path), "--plant"]) == 2
    assert "holds no diagnosis" in capsys.readouterr().err
    (tmp_path / "diagnosis.json").write_text('{"format": "rover-sweep diagnosis", "format_version": 1}')
    assert run(["export", str(tmp_path), "--plant"]) == 2
    assert "is damaged" in capsys.readouterr().err
