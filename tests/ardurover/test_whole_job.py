"""The whole job on the official firmware: from the factory to identified parameters, and what it recorded.

In real time, two to three minutes each, where the programs are found.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from conversation_file import read_conversation
from firmware_jobs import Job, whole_job
from transport_replayed import ReplayedLine

from rover_sweep.cli.driving.simulated import truth
from rover_sweep.session.session import drive
from rover_sweep.vehicle.events import LogSaved, ParameterSet, Rebooting, RunFinished
from sitl.plant.variant import load_variant

pytestmark = pytest.mark.ardurover

# of the plant's truth; one sweep of 20 s
WITHIN = {"C": 0.15, "Cf": 0.2, "Cr": 0.2, "Izz": 0.15, "k_phi": 0.1, "tau": 0.3}


def prepared_driven_and_fetched(job: Job) -> None:
    """From the factory: parameters set, rebooted for them, both runs driven, one log."""
    changed = {event.name for event in job.events if isinstance(event, ParameterSet)}
    assert {"SCR_ENABLE", "SCHED_LOOP_RATE", "INS_GYRO_FILTER", "RC6_OPTION"} <= changed
    reboots = [event.because for event in job.events if isinstance(event, Rebooting)]
    assert reboots == [("SCR_ENABLE", "SCHED_LOOP_RATE")]
    finished = [event for event in job.events if isinstance(event, RunFinished)]
    whole = "the manoeuvre ran to its end"
    assert [(run.name, run.reason) for run in finished] == [("sweep1", whole), ("doublet", whole)]
    assert len([event for event in job.events if isinstance(event, LogSaved)]) == 1


def played_back(job: Job, folder: Path) -> None:
    """The job's own recording through the same code: the same log, byte by byte, the same run ends."""
    (path,) = job.folder.glob("*.conversation")
    conversation = read_conversation(path)
    line = ReplayedLine(conversation)
    events = list(drive(conversation.about["url"], folder, job.plan, line))
    line.finish()
    spans = [[e.span for e in some if isinstance(e, RunFinished)] for some in (events, job.events)]
    assert spans[0] == spans[1]
    (then,), (now,) = job.folder.glob("*.BIN"), folder.glob("*.BIN")
    assert now.read_bytes() == then.read_bytes()


def as_the_plant(job: Job) -> None:
    """The roll-yaw model's parameters beside the plant's own."""
    true, found = truth(load_variant("nominal")), job.found["roll-yaw"]
    assert "C" in found or {"Cf", "Cr"} <= found.keys()
    for name, within in WITHIN.items():
        if name in found or name not in ("C", "Cf", "Cr"):
            assert found[name] == pytest.approx(true[name], rel=within), name


@pytest.mark.parametrize("trigger", ["override", "aux", "pilot"])
def test_on_the_plant(ardurover: Path, tmp_path: Path, trigger: str) -> None:
    job = whole_job(ardurover, tmp_path, trigger)  # type: ignore[arg-type]
    for check in CHECKS:
        check(job)
    played_back(job, tmp_path / "again")


def test_on_another_version(older: Path, tmp_path: Path) -> None:
    job = whole_job(older, tmp_path, "pilot")
    for check in CHECKS:
        check(job)
    played_back(job, tmp_path / "again")


def test_on_the_firmwares_own_rover(ardurover: Path, tmp_path: Path) -> None:
    """It is kinematic: a wheelbase is found, and no tyres are."""
    job = whole_job(ardurover, tmp_path, "override", "own")
    prepared_driven_and_fetched(job)
    assert job.found["kinematic"]["L_eff"] == pytest.approx(0.516, rel=0.05)
    assert "roll-yaw" not in job.found or "C" not in job.found["roll-yaw"]


CHECKS: tuple[Callable[[Job], None], ...] = (prepared_driven_and_fetched, as_the_plant)
