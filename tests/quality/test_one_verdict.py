"""Every command and screen says the same of one run, word for word."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rover_sweep as rs
from rover_sweep.cli.main import run as command
from rover_sweep.live.verdict import judge
from rover_sweep.quality.verdict import assess

DATA = Path(__file__).parents[1] / "data"
RUNS = [
    "ardurover-4.6.3/nominal/run1.BIN",
    "ardurover-4.6.3/nominal/run2.BIN",
    "ardurover-4.6.3/applet/run1.tlog",
    "ardurover-4.6.3/defaults/run1.tlog",
]


@pytest.mark.parametrize("name", RUNS)
def test_identify_coherence_session_and_python_agree(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, rover = DATA / name, DATA / "rover.toml"
    runs = rs.read(log, vehicle=rover)
    (python,) = runs.coherence()
    (identified,) = rs.identify(runs, models=["bicycle"], bootstrap=0).coherence
    session = judge(log, (0.0, 1e9), python.run, runs.vehicle)
    assert command(["coherence", str(log), "--vehicle", str(rover), "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)
    said = {(v.advice, v.sentence) for v in (python, identified, session)} | {
        (told["advice"], told["sentence"])
    }
    assert len(said) == 1, said


def test_noise_changes_them_all_alike(tmp_path: Path) -> None:
    (run,) = rs.read(DATA / RUNS[0], vehicle=DATA / "rover.toml")
    noise = 3.0 * np.random.default_rng(1).standard_normal(run["ay"].x.size)
    noisy = replace(run, channels={**run.channels, "ay": replace(run["ay"], x=run["ay"].x + noise)})
    by_angle, by_pulse = assess(noisy), assess(noisy.without({"delta"}))
    assert by_angle.advice == "repeat" and "repeat with" in by_angle.sentence
    assert by_angle.sentence == by_pulse.sentence
