from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_vehicle import FakeVehicle

from rover_sweep.vehicle.link.link import Link


@pytest.fixture
def vehicle() -> Iterator[FakeVehicle]:
    with FakeVehicle() as fake:
        yield fake


@pytest.fixture
def link(vehicle: FakeVehicle, tmp_path: Path) -> Iterator[Link]:
    with Link.open(vehicle.url, tmp_path / "test.tlog") as opened:
        yield opened
