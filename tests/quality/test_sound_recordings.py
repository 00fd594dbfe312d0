"""Recordings that nothing is wrong with are not accused: those of the project, and of real hardware."""

from __future__ import annotations

from pathlib import Path

import pytest

from rover_sweep.errors import DataRefused
from rover_sweep.logs.read import read_runs
from rover_sweep.quality.faults import each_with_length, faults_of

DATA = Path(__file__).parents[1] / "data"
CARS = ("dart_free_driving_2024", "umich_ardupilot_rover_circles_2017", "umich_nvidia_rover_joystick_2017")
LOGS = sorted(
    p for kind in ("BIN", "tlog") for p in DATA.rglob(f"*.{kind}") if not {"gains", "throttle"} & {*p.parts}
)


def test_the_recordings_are_there() -> None:
    assert len(LOGS) == 43


@pytest.mark.parametrize("path", LOGS, ids=lambda p: "/".join(p.relative_to(DATA).parts))
def test_a_sound_log_is_not_accused(path: Path) -> None:
    runs = read_runs(str(path))
    assert runs
    assert [fault.text for run in each_with_length(runs) for fault in faults_of(run)] == []


@pytest.mark.parametrize("name", CARS)
def test_a_real_car_is_not_accused(foreign_recordings: Path, name: str) -> None:
    try:
        runs = read_runs(
            str(foreign_recordings / "cars" / f"{name}.csv"),
            column_map=str(DATA / "cars" / f"{name}.columns.toml"),
        )
    except DataRefused as refusal:
        pytest.fail(str(refusal))
    assert [fault.text for run in each_with_length(runs) for fault in faults_of(run)] == []
