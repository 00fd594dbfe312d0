"""Where the recordings are: committed ones in tests/data, those of others next to the repository."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
DATA = REPOSITORY / "tests" / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"
DEFAULTS = DATA / "ardurover-4.6.3" / "defaults"
APPLET = DATA / "ardurover-4.6.3" / "applet"
STOCK = DATA / "ardurover-4.6.3" / "stock"
OLDER = DATA / "ardurover-4.5.7" / "nominal"


def foreign(name: str) -> str:
    """Path of a recording that must not be part of the project; skips where it is absent."""
    folder = Path(os.environ.get("ROVER_SWEEP_RECORDINGS", REPOSITORY.parent / "shared" / "recordings"))
    if not (folder / name).exists():
        pytest.skip(f"{name} is not in {folder} (ROVER_SWEEP_RECORDINGS)")
    return str(folder / name)
