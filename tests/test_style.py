"""The arrows between the parts, and the linters."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return names


@pytest.mark.parametrize(("folder", "forbidden"), [
    ("sitl", ("rover_sweep",)),
    ("firmware_params", ("rover_sweep", "sitl")),
    ("rover_sweep/identify", ("sitl", "rover_sweep.logs", "rover_sweep.vehicle", "rover_sweep.cli",
                              "rover_sweep.report", "pymavlink", "click", "rich", "matplotlib")),
    ("rover_sweep/logs", ("sitl", "rover_sweep.vehicle", "rover_sweep.cli", "rover_sweep.report")),
    ("rover_sweep/report", ("sitl", "rover_sweep.cli", "rover_sweep.logs", "rover_sweep.vehicle.")),
])  # fmt: skip
def test_arrows(folder: str, forbidden: tuple[str, ...]):
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    for path in files:
        wrong = [
            n for n in imported(path) if any(n == f or n.startswith(f.rstrip(".") + ".") for f in forbidden)
        ]
        assert not wrong, f"{path.relative_to(ROOT)} imports {wrong}"


def test_pymavlink_is_wrapped_in_one_module():
    users = [
        p for p in (ROOT / "rover_sweep/vehicle").rglob("*.py") if any("pymavlink" in n for n in imported(p))
    ]
    assert [p.name for p in users] == ["mavlink.py"]


@pytest.mark.parametrize("command", [["ruff", "check", "."], ["ruff", "format", "--check", "."], ["mypy"]])
def test_linters(command: list[str]):
    done = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
