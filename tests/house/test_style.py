"""pymavlink in one module, the linters, and no dead code."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_pymavlink_is_wrapped_in_one_module():
    users = [
        p
        for p in (ROOT / "rover_sweep/vehicle").rglob("*.py")
        if re.search(r"^\s*(import|from) pymavlink", p.read_text(), re.M)
    ]
    assert [p.name for p in users] == ["mavlink.py"]


@pytest.mark.parametrize("command", [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"]])
def test_linters(command: list[str]):
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_dead_code():
    """What only tests use counts as dead. False findings go to vulture_whitelist.py, each with its reason."""
    pytest.importorskip("vulture")
    done = subprocess.run([sys.executable, "-m", "vulture"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
