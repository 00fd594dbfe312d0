"""Identifications of the recorded runs, made once for all tests of the report."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pytest

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Recording, steered
from rover_sweep.data.vehicle_file import load
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.pipeline import Identification, identify
from rover_sweep.logs.read import read_runs
from rover_sweep.report.identification.report import write_report
from rover_sweep.report.wording import Provenance, provenance

DATA = Path(__file__).parents[1] / "data"
RECORDINGS = DATA / "ardurover-4.6.3"
ROVER = DATA / "rover.toml"
GEOMETRY = Geometry(2.66, 0.203, 0.188, 2.40, 0.058, 0.0125, imu_x=0.0, imu_z=0.0)


class Case(NamedTuple):
    """A result and where it comes from."""

    result: Identification
    provenance: Provenance


def runs(*sources: str) -> tuple[Recording, ...]:
    """Recordings under the data folder, with the steering angle."""
    found = [
        run for s in sources for run in read_runs("+".join(str(RECORDINGS / part) for part in s.split("+")))
    ]
    return tuple(steered(run, 1500.0, 0.00095) for run in found)


def case(sweeps: tuple[str, ...], checks: tuple[str, ...], settings: Settings | None = None) -> Case:
    """Identified and verified."""
    verify = runs(*checks)
    origin = provenance(load(ROVER), ROVER, verify, "rover-sweep identify")
    return Case(identify(runs(*sweeps), GEOMETRY, verify, settings), origin)


@pytest.fixture(scope="session")
def nominal() -> Case:
    """Two sweeps and a doublet, three models."""
    return case(("nominal/run1.BIN", "nominal/run2.BIN"), ("nominal/run4.BIN",))


@pytest.fixture(scope="session")
def stock() -> Case:
    """A kinematic rover, whose tyres cannot be identified."""
    return case(("stock/run1.BIN",), ("stock/run2.BIN",))


@pytest.fixture(scope="session")
def defaults() -> Case:
    """The gyro behind a 4 Hz low-pass; the roll-yaw model alone, not verified."""
    sweeps = ("defaults/run1.BIN+defaults/run1.tlog",)
    return case(sweeps, (), Settings(models=("roll-yaw",)))


@pytest.fixture(scope="session")
def reports(nominal: Case, stock: Case, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Report folders of two cases."""
    folders = {}
    for name, found in (("nominal", nominal), ("stock", stock)):
        folders[name] = tmp_path_factory.mktemp(name)
        write_report(found.result, folders[name], found.provenance)
    return folders
