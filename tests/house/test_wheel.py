"""The wheel holds all that the program needs, and works without the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from email import message_from_string
from pathlib import Path

import pytest
import yaml

from rover_sweep import __version__

ROOT = Path(__file__).parents[2]
PACKAGES = ("rover_sweep", "firmware_params", "sitl")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    pytest.importorskip("hatchling")
    out = tmp_path_factory.mktemp("dist")
    call = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-t", "wheel", "-d", str(out)]
    done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = out.glob("*.whl")
    return zipfile.ZipFile(path)


def test_it_holds_every_file_of_the_packages(wheel: zipfile.ZipFile) -> None:
    files = [path for name in PACKAGES for path in (ROOT / name).rglob("*") if path.is_file()]
    wanted = {str(path.relative_to(ROOT)) for path in files if "__pycache__" not in path.parts}
    held = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert held == wanted
    kinds = {"rover_sweep.lua", "identification.param", "document.html.j2", "nominal.toml", "py.typed"}
    assert kinds <= {Path(name).name for name in held}


def test_its_metadata_are_those_of_an_index(wheel: zipfile.ZipFile) -> None:
    (name,) = (name for name in wheel.namelist() if name.endswith("/METADATA"))
    metadata = message_from_string(wheel.read(name).decode())
    assert (metadata["Version"], metadata["License-Expression"]) == (__version__, "MIT")
    assert metadata["Description-Content-Type"] == "text/markdown"
    pytest.importorskip("twine")
    built = [str(path) for path in Path(str(wheel.filename)).parent.iterdir()]
    assert len(built) == 2  # the wheel and the sdist
    call = [sys.executable, "-m", "twine", "check", "--strict", *built]
    done = subprocess.run(call, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_it_runs_without_the_checkout(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    wheel.extractall(tmp_path / "installed")
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "installed")}
    words = {"--version": __version__, "firmware applet -o applet.lua": "applet.lua", "--help": "dry-run"}
    for call, said in words.items():
        command = [sys.executable, "-m", "rover_sweep", *call.split()]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0 and said in done.stdout + done.stderr, done.stdout + done.stderr
    assert (tmp_path / "applet.lua").read_bytes() == wheel.read("firmware_params/rover_sweep.lua")


def test_the_version_is_one_wherever_it_is_written() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == __version__
    assert f"## [{__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
