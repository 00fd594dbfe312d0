"""`export --python` and `--fmu`: the simulated rover of a variant or a folder for other programs."""

from __future__ import annotations

import subprocess
import sys
import zipfile
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


def test_a_variant_is_found_by_file_and_folder(variant, tmp_path, capsys):
    out, texts = tmp_path / "my_rover.py", set()
    for place in ("report/variant.toml", "report", "."):
        assert run(["export", str(tmp_path / place), "--python", str(out)]) == 0
        assert "simulated rover of variant.toml written to" in capsys.readouterr().err
        texts.add(out.read_text())
    (text,) = texts
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
        (["report", "--fmu", "rover-twin.fmu"], "not a name for an FMU"),
        (["report", "--fmu", "rover.fmu", "-o", "x"], "write the whole rover"),
        (["report", "--python", "absent/rover.py"], "there is no folder"),
        (["report", "--python", "rover.py", "--plant"], "write the whole rover"),
        (["empty", "--python", "rover.py"], "holds no simulated rover"),
        (["wrong.toml", "--python", "rover.py"], "there is no effect tires"),
        (["stiff.toml", "--python", "rover.py"], "too stiff to simulate"),
        (["binary.toml", "--python", "rover.py"], "not a TOML file"),
    ],
)
def test_wrong_words_are_refused(variant, words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "wrong.toml").write_text('base = "nominal"\n[effects]\ntires = { k = 1 }\n')
    (tmp_path / "stiff.toml").write_text('base = "nominal"\nfront_cornering_stiffness = 9e5\n')
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    assert run(["export", *words]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "rover.py").exists()


def test_an_fmu_without_pythonfmu_is_refused(variant, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sitl.twin.fmu_file.can_build", lambda: False)
    assert run(["export", str(variant), "--fmu", str(tmp_path / "rover.fmu")]) == 2
    assert "run: pip install -e '.[fmu]'" in capsys.readouterr().err
    assert not (tmp_path / "rover.fmu").exists()


def test_an_fmu_holds_the_rover_of_the_variant(variant: Path, tmp_path: Path) -> None:
    pytest.importorskip("pythonfmu")
    out = tmp_path / "my_rover.fmu"
    assert run(["export", str(variant.parent), "--fmu", str(out)]) == 0
    with zipfile.ZipFile(out) as fmu:
        (twin,) = (name for name in fmu.namelist() if "/rover_twin" in name)
        text = fmu.read(twin).decode()
        assert "binaries/linux64/my_rover.so" in fmu.namelist()
    assert "mass=3.5," in text and "the numbers of variant.toml." in text
    assert all(str(tmp_path) not in words for words in (text, out.read_bytes().decode("latin-1")))


def test_a_failed_build_says_why(variant, tmp_path, monkeypatch, capsys):
    """A pythonfmu that breaks down: here one that is no package."""
    (tmp_path / "pythonfmu.py").write_text("raise SystemExit('no binary for this machine')")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert run(["export", str(variant), "--fmu", str(tmp_path / "rover.fmu")]) == 2
    assert "could not build the FMU: no binary for this machine" in capsys.readouterr().err
