"""Recordings that are sound."""

from __future__ import annotations

import pytest
from damage import NOMINAL

from rover_sweep.data.recording import Recording
from rover_sweep.logs.read import read_runs


@pytest.fixture(scope="session")
def sweep() -> Recording:
    """A sweep of the official firmware, which nothing is wrong with."""
    (run,) = read_runs(str(NOMINAL / "run1.BIN"))
    return run
