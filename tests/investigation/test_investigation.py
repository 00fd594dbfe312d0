"""The loop: one run for each decision, nothing driven before the decision was seen, limits that are kept."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from fabricated import PLAY, explained, unexplained

from rover_sweep.api.investigation import (
    Bounds,
    Decision,
    choices,
    decided,
    first_sweep,
    fits,
    investigation,
    investigation_document,
    steps_before,
    write_investigation,
)
from rover_sweep.data.recording import Recording, steered
from rover_sweep.data.vehicle_file import Vehicle, load
from rover_sweep.diagnosis.plans.planner import PlannedRun
from rover_sweep.errors import UsageError
from rover_sweep.logs.read import read_runs


@pytest.fixture(scope="module")
def vehicle(data: Path) -> Vehicle:
    return load(data / "rover.toml")


@pytest.fixture(scope="module")
def recorded(data: Path, vehicle: Vehicle) -> dict[str, Recording]:
    folder = data / "ardurover-4.6.3" / "nominal"
    found = [steered(read_runs(str(folder / f"run{k}.BIN"))[0], *vehicle.steering()) for k in (1, 4)]
    return {run.kind: run for run in found}


class FakeDriver:
    """Notes the runs that it is told to drive; a recording of that kind stands for each."""

    def __init__(self, recorded: dict[str, Recording], completes: bool = True) -> None:
        self.recorded, self.completes = recorded, completes
        self.told: list[PlannedRun] = []
        self.kept: list[Recording] = []

    def recordings(self) -> tuple[Recording, ...]:
        return tuple(self.kept)

    def drive(self, run: PlannedRun) -> bool:
        self.told.append(run)
        if self.completes:
            kind = "doublet" if run.kind == "doublet" else "sweep"
            self.kept.append(replace(self.recorded[kind], name=f"run{len(self.told)}"))
        return self.completes

    def spent(self) -> str:
        return ""


def test_each_decision_drives_one_run_and_only_after_it_was_seen(
    recorded: dict[str, Recording], vehicle: Vehicle
) -> None:
    driver = FakeDriver(recorded)
    decisions = investigation(driver, vehicle, Bounds(), lambda given: explained(PLAY))
    for number in range(2):
        decision = next(decisions)
        assert decision.step.run is not None and len(driver.told) == number
    last = next(decisions)
    assert last.step.action == "settled" and len(driver.told) == 2
    assert list(decisions) == [] and len(driver.told) == 2


def test_runs_that_do_not_come_to_their_end_count_and_are_not_driven_for_ever(
    recorded: dict[str, Recording], vehicle: Vehicle
) -> None:
    driver = FakeDriver(recorded, completes=False)
    decisions = list(investigation(driver, vehicle, Bounds(runs=3)))
    assert [d.step.action for d in decisions] == ["drive", "drive", "drive", "used up"]
    assert len(driver.told) == 3
    driver = FakeDriver(recorded)
    interrupted = investigation(driver, vehicle, Bounds())
    next(interrupted)
    interrupted.close()
    assert driver.told == []


def test_the_same_runs_are_diagnosed_once(recorded: dict[str, Recording], vehicle: Vehicle) -> None:
    driver, asked = FakeDriver(recorded), list[int]()
    found = unexplained()

    def diagnose(given: object) -> object:
        asked.append(1)
        driver.completes = False
        return replace(found, scores={})

    list(investigation(driver, vehicle, Bounds(runs=5), diagnose))  # type: ignore[arg-type]
    assert len(driver.told) == 5 and len(asked) == 1


def test_choices_keep_speed_amplitude_headings_and_ground(vehicle: Vehicle) -> None:
    bounds = Bounds(speed=2.0, amplitude_us=150.0, headings=False)
    found = choices([PlannedRun("sweep", 150.0, 2.0)], vehicle, bounds)
    assert found and all(run.speed <= 2.0 and run.heading is None for run in found)
    assert all(run.amplitude_us + abs(run.bias_us) <= 150.0 for run in found)
    assert {run.kind for run in found} <= {"sweep", "bias_sweep", "multisine"}
    assert any(run.heading is not None for run in choices(found, vehicle, replace(bounds, headings=True)))
    assert not choices(found, vehicle, replace(bounds, ground=(5.0, 5.0)))
    assert {run.speed for run in choices(found, vehicle, replace(bounds, slowest=1.8))} == {2.0}
    assert fits(found[0], vehicle, (1000.0, 1000.0))


def test_ground_that_is_too_small_ends_it_before_anything_is_driven(vehicle: Vehicle) -> None:
    step = decided((), vehicle, Bounds(ground=(10.0, 3.0))).step
    assert step.action == "used up" and "ground" in step.reason
    with pytest.raises(UsageError, match="give a smaller --speed"):
        first_sweep(vehicle, Bounds(speed=25.0))


def test_the_document_keeps_the_steps_of_an_earlier_call(
    recorded: dict[str, Recording], vehicle: Vehicle, tmp_path: Path
) -> None:
    driver = FakeDriver(recorded)
    first: list[Decision] = list(investigation(driver, vehicle, Bounds(runs=1)))
    write_investigation(tmp_path, first, ())
    kept = steps_before(tmp_path)
    again = list(investigation(driver, vehicle, Bounds(), lambda given: explained(PLAY)))
    document = investigation_document(again, kept)
    assert [s["number"] for s in document["steps"]] == [1, 2, 3, 4]
    assert document["settled"] and document["effects"] == ["steering_backlash"]
    assert json.loads((tmp_path / "investigation.json").read_text())["action"] == "used up"
    assert steps_before(tmp_path / "none") == ()
    (tmp_path / "investigation.json").write_text('{"steps": [1')
    with pytest.raises(UsageError, match="rename it to keep it"):
        steps_before(tmp_path)
