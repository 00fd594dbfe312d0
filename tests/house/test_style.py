"""The linters, no dead code, and how texts say to install."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_no_text_installs_this_package_by_its_name():
    """It is on no index, where anybody could register the name; an extra is installed from the checkout."""
    folders = ("rover_sweep", "sitl", "firmware_params", "docs")
    texts = {
        str(p.relative_to(ROOT)): p.read_text()
        for p in (*ROOT.glob("*.md"), *(p for f in folders for p in (ROOT / f).rglob("*")))
        if p.suffix in (".py", ".md", ".ipynb", ".toml", ".html", ".j2", ".lua")
    }
    by_name = r"""rover[-_]sweep\[|install[\s"'\\]+(?:-[-\w]+\s+)*["']?rover[-_]sweep\b"""
    assert not {name: found[0] for name, text in texts.items() if (found := re.search(by_name, text))}
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    asked = r"""-e '\.\[(\w+)\]'|missing_extra\([^)]*"(\w+)"\)"""
    assert {a or b for text in texts.values() for a, b in re.findall(asked, text)} == set(extras)


@pytest.mark.parametrize(
    "command", [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["pyrefly", "check"]]
)
def test_linters(command: list[str]):
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_dead_code():
    """What only tests use counts as dead. False findings go to vulture_whitelist.py, each with its reason."""
    pytest.importorskip("vulture")
    done = subprocess.run([sys.executable, "-m", "vulture"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
