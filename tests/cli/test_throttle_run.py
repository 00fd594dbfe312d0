"""`run --throttle-sweep` on the embedded rover: from the drive to speed.json."""

from __future__ import annotations

import json

from rover_sweep.cli.main import run
from rover_sweep.session.folder import read_folder


def test_a_throttle_sweep_from_the_drive_to_the_law(tmp_path, capsys):
    out = tmp_path / "run"
    sweep = "60,0.4,8,20,fade=1,dwell=1,straight=1"
    assert run(["run", "--simulator", "embedded", "--throttle-sweep", sweep, "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert "response of the speed to the throttle" in said.out.lower() and "discard" not in said.err
    found = json.loads((out / "report" / "speed.json").read_text())
    assert found["level"] in ("good", "acceptable")
    low, high = found["intervals"]["lag"]
    assert low < 0.75 and high > 0.65, "the plant's lag is 0.7 s"
    (log,) = read_folder(out).logs
    assert log.runs == ("throttle1",)


def test_a_sweep_past_the_limit_is_refused_before_anything_moves(tmp_path, capsys):
    given = ["--throttle-sweep", "600", "--out", str(tmp_path / "run")]
    assert run(["run", "--simulator", "embedded", *given]) != 0
    assert "SWP_AMP 600" in capsys.readouterr().err
