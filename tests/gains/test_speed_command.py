"""identify recognises a throttle sweep, and gains proposes the speed loop from it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from firmware_params.param_files import parse
from rover_sweep.cli.main import cli, run

DATA = Path(__file__).parents[1] / "data"
SWEEP = DATA / "ardurover-4.6.3" / "throttle" / "sweep.BIN"


def called(*arguments: object) -> tuple[int, str, str]:
    result = CliRunner().invoke(cli, [str(a) for a in arguments])
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("speed")
    code, printed, said = called("identify", SWEEP, "--out", out)
    assert code == 0, said
    assert printed.startswith("GOOD\nATC_SPEED_P")
    assert "dead zone" in printed and "coasting" in printed
    return out


def test_gains_of_the_speed(report: Path, tmp_path: Path) -> None:
    file = tmp_path / "speed.param"
    code, printed, said = called("gains", report, "--out", file)
    assert code == 0, said
    assert "Speed loop for 1.54 to 3.01 m/s" in printed and "overshoot" in printed
    written = {p.name: p.value for p in parse(file.read_text())}
    assert written.keys() == {
        "CRUISE_SPEED",
        "CRUISE_THROTTLE",
        "ATC_SPEED_P",
        "ATC_SPEED_I",
        "ATC_SPEED_D",
        "ATC_ACCEL_MAX",
    }
    assert 0.5 < written["ATC_SPEED_P"] < 2.0


def test_gains_as_json(report: Path) -> None:
    code, printed, _ = called("gains", report / "speed.json", "--json")
    document = json.loads(printed)
    assert code == 0 and document["format"] == "rover-sweep gains"
    assert document["speed_loop"]["proposed"]["worst_gain_margin_db"] >= 6
    assert "limits" not in document


def test_json_of_a_throttle_sweep_alone(tmp_path: Path) -> None:
    code, printed, _ = called("identify", SWEEP, "--out", tmp_path, "--json")
    assert code == 0 and json.loads(printed)["format"] == "rover-sweep speed"


def test_damaged_speed_file_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "speed.json").write_text('{"law": null}')
    assert run(["gains", str(tmp_path)]) != 0
    assert "no speed gains can be computed from" in capsys.readouterr().err
