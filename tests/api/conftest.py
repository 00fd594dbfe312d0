"""A sweep and a doublet of the nominal rover, and what identification makes of them, once for all tests."""

from __future__ import annotations

from pathlib import Path

import pytest

import rover_sweep as rs
from rover_sweep.api.read import Runs

DATA = Path(__file__).parents[1] / "data"
NOMINAL = DATA / "ardurover-4.6.3" / "nominal"


@pytest.fixture(scope="session")
def runs() -> Runs:
    return rs.read(NOMINAL / "run1.BIN", NOMINAL / "run4.BIN", vehicle=DATA / "rover.toml")


@pytest.fixture(scope="session")
def result(runs: Runs) -> rs.Result:
    return rs.identify(runs, bootstrap=20)
