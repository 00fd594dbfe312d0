"""`export --python`: the simulated rover of a variant, a report folder or a diagnosis as one Python file."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from rover_sweep.cli.main import run
from sitl.plant.variant import load_variant
from sitl.twin.python_file import python_file

VARIANT = """# Rover diagnosed by rover-sweep: roll-yaw model with tyre_relaxation.
# Everything else is as in the nominal simulated rover.
base = "nominal"
mass = 3.5
# not a remark on the whole
[effects]
tyre_relaxation = { sigma = 0.25 }
"""


@pytest.fixture
def variant(tmp_path: Path) -> Path:
    path = tmp_path / "report" / "variant.toml"
    path.parent.mkdir()
    path.write_text(VARIANT)
    return path


@pytest.mark.parametrize("place", ["report/variant.toml", "report", "."])
def test_a_variant_is_found_by_file_and_folder(
    variant: Path, place: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "my_rover.py"
    assert run(["export", str(tmp_path / place), "--python", str(out)]) == 0
    assert "simulated rover of variant.toml written to" in capsys.readouterr().err
    text = out.read_text()
    assert "mass=3.5," in text and "'tyre_relaxation': {'sigma': 0.25}" in text
    assert "from my_rover import Rover" in text
    assert "roll-yaw model with tyre_relaxation." in text and "not a remark" not in text
    assert str(tmp_path) not in text, "no folder of this machine"
    body = python_file(load_variant(variant), ["x"], "my_rover").partition("from __future__")[2]
    assert text.endswith(body)
    assert subprocess.run([sys.executable, "-I", str(out)], capture_output=True).returncode == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["report", "--python", "rover-twin.py"], "Python cannot import this name"),
        (["report", "--python", "rover.toml"], "Python cannot import this name"),
        (["report", "--python", "absent/rover.py"], "there is no folder"),
        (["report", "--python", "rover.py", "--plant"], "--python writes the whole rover"),
        (["report", "--python", "rover.py", "-o", "x"], "--python writes the whole rover"),
        (["report", "--python", "rover.py", "--speed", "2"], "--python writes the whole rover"),
        (["empty", "--python", "rover.py"], "holds no simulated rover"),
        (["absent.toml", "--python", "rover.py"], "holds no simulated rover"),
        (["wrong.toml", "--python", "rover.py"], "there is no effect tires"),
        (["stiff.toml", "--python", "rover.py"], "too stiff to simulate"),
        (["binary.toml", "--python", "rover.py"], "not a TOML file"),
    ],
)
def test_wrong_words_are_refused(
    variant: Path,
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "wrong.toml").write_text('base = "nominal"\n[effects]\ntires = { k = 1 }\n')
    (tmp_path / "stiff.toml").write_text('base = "nominal"\nfront_cornering_stiffness = 9e5\n')
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    assert run(["export", *words]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "rover.py").exists()
