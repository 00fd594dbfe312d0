"""A gyro or accelerometer that is clipped below its full range is named, and no model of it is good."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from damage import NOMINAL, clipped, damaged, rewritten

import rover_sweep as rs
from rover_sweep.cli.main import run as program
from rover_sweep.data.recording import Recording
from rover_sweep.quality.faults import CLIPPED, faults_of

VEHICLE = NOMINAL.parents[1] / "rover.toml"


@pytest.mark.parametrize(("channel", "share"), [("r", 0.9), ("r", 0.6), ("p", 0.6), ("ay", 0.7)])
def test_a_plateau_at_the_extremes_is_named(sweep: Recording, channel: str, share: float) -> None:
    (fault,) = faults_of(clipped(sweep, channel, share))
    assert (fault.fault, fault.spoils) == (CLIPPED, (channel,))
    limit = share * float(np.max(np.abs(sweep.manoeuvre(channel).x)))
    assert f"{channel} is clipped: it stays at" in fault.text and f"{limit:.4g}" in fault.text


def test_one_side_is_enough(sweep: Recording) -> None:
    top = 0.8 * float(np.max(sweep.manoeuvre("r").x))
    (fault,) = faults_of(damaged(sweep, r=lambda x: np.minimum(x, top)))
    assert fault.fault == CLIPPED


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_a_coarse_sensor_is_not_clipped(sweep: Recording, step: float) -> None:
    coarse = {c: (lambda x: step * np.round(x / step)) for c in ("r", "p", "ay")}
    assert faults_of(damaged(sweep, **coarse)) == ()


def test_a_held_answer_is_not_clipped(sweep: Recording) -> None:
    """Where the steering is held, so may the rover's answer be."""
    wave = np.clip(2 * np.sin(0.5 * (sweep["pwm"].t - sweep.span[0])), -1, 1)
    r = np.interp(sweep["r"].t, sweep["pwm"].t, wave)
    assert faults_of(damaged(sweep, pwm=lambda _: 1500 - 100 * wave, r=lambda _: r)) == ()


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory, sweep: Recording) -> Path:
    limit = 0.7 * float(np.max(np.abs(sweep.manoeuvre("r").x)))
    out = tmp_path_factory.mktemp("clipped") / "run1.BIN"
    return rewritten(NOMINAL / "run1.BIN", out, {("IMU", "GyrZ"): lambda x: min(max(x, -limit), limit)})


def test_the_commands_say_it(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert program(["coherence", "--json", str(log)]) == 0
    (verdict,) = json.loads(capsys.readouterr().out)
    assert not verdict["keep"] and verdict["sentence"].startswith("repeat: r is clipped: it stays at")
    assert [note["fault"] for note in verdict["notes"] if note["fault"]] == [CLIPPED]
    options = ["--vehicle", str(VEHICLE), "--bootstrap", "0", "--out", str(tmp_path)]
    assert program(["identify", str(log), *options]) == 0
    document = json.loads((tmp_path / "identification.json").read_text())
    assert document["recommended"] is None
    assert {m["verdict"]["level"] for m in document["models"].values()} <= {"poor", "not identifiable"}
    assert "r is clipped" in (tmp_path / "report.html").read_text()


def test_no_diagnosis_is_made_of_a_clipped_yaw_rate(log: Path) -> None:
    found = rs.diagnose(rs.read(log, vehicle=VEHICLE))
    assert found.verdict == "refused" and "r is clipped" in found.sentence


def test_the_bicycle_does_without_a_clipped_roll_rate(sweep: Recording) -> None:
    runs = rs.read(NOMINAL / "run1.BIN", vehicle=VEHICLE)
    bad = rs.Runs((clipped(runs[0], "p", 0.5),), runs.vehicle)
    result = rs.identify(bad, models=("bicycle", "roll-yaw"), bootstrap=0)
    assert result.models["roll-yaw"].verdict.level == "poor"
    assert "p is clipped" in result.models["roll-yaw"].verdict.sentences[0]
    assert "--fit r,ay" in result.models["roll-yaw"].verdict.sentences[0]
    assert result.models["bicycle"].verdict.level == "good" and result.recommended == "bicycle"
    assert any("p is clipped" in words for words in result.summary)
