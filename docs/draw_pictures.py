"""Draw the pictures of the documentation: `python docs/draw_pictures.py`, from the top of a checkout.

They are pictures of the report that `identify` writes for the recorded nominal rover.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from rover_sweep.cli.main import run

HERE = Path(__file__).parent
NOMINAL = HERE.parent / "tests/data/ardurover-4.6.3/nominal"
PICTURES = ("models.svg", "verification-run4.svg")


def draw() -> None:
    """Copy the report's pictures into docs/pictures."""
    with tempfile.TemporaryDirectory() as folder:
        sweeps = [str(NOMINAL / f"run{n}.BIN") for n in (1, 2)]
        vehicle = ["--vehicle", str(HERE.parent / "tests/data/rover.toml")]
        code = run(["identify", *sweeps, "--verify", str(NOMINAL / "run4.BIN"), *vehicle, "--out", folder])
        if code:
            sys.exit(code)
        for name in PICTURES:
            shutil.copy(Path(folder) / "pictures" / name, HERE / "pictures" / name)


if __name__ == "__main__":
    draw()
