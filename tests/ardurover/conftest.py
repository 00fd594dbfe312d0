"""The official firmware's programs, where there are any."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest

from sitl.launcher import ENVIRONMENT, LaunchError, find_ardurover

sys.path.append(str(Path(__file__).parents[1] / "vehicle"))  # transport_replayed

OLD = "ROVER_SWEEP_ARDUROVER_OLD"


@pytest.fixture(scope="session")
def ardurover() -> Path:
    """The firmware that is found; skips without one."""
    try:
        return find_ardurover()
    except LaunchError as error:
        pytest.skip(f"no firmware to try: {error} ({ENVIRONMENT})")


@pytest.fixture(scope="session")
def older() -> Path:
    """Another version of it, named by the environment; skips without one."""
    name = os.environ.get(OLD, "")
    found = shutil.which(name) if name else None
    if found is None:
        pytest.skip(f"no second version of the firmware: set {OLD} to its program")
    return Path(found)


@pytest.fixture(autouse=True)
def same_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs are played back, so each draws the number that it drew."""
    monkeypatch.setattr("rover_sweep.vehicle.run.one_run.drawn", lambda: 17)
