"""The whole job on the official firmware, timed part by part; also as a program that prints the figures:

python tests/ardurover/firmware_jobs.py ARDUROVER [override|aux|pilot [plant|own]]
"""

from __future__ import annotations

import itertools
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_params.applet_parameters import applet_path
from firmware_params.param_files import read, shipped
from rover_sweep.cli.driving.simulated import firmware_rover_text, rover_text
from rover_sweep.manoeuvre.sweep import Doublet, Sweep
from rover_sweep.session.content import SessionRun
from rover_sweep.session.session import SessionPlan, drive
from rover_sweep.session.simulated_rover import Physics, SimulatedRover, pilot, started
from rover_sweep.vehicle.events import (
    Connected,
    Event,
    LogSaved,
    Rebooting,
    RunFinished,
    RunStarted,
    SessionFinished,
)
from rover_sweep.vehicle.link.recorded_transport import RecordedLine, conversation_in
from rover_sweep.vehicle.run.controls import RunSettings, Trigger

RUNS = (
    SessionRun("sweep1", Sweep(amplitude=150, w_min=1, w_max=20, t_rec=20)),
    SessionRun("doublet", Doublet(amplitude=150)),
)
LIMITS = {"gcs": 1.0, "v_min": 1.0, "v_max": 5.0}
_PARTS = {  # the part that ends with this event
    Rebooting: "parameters set",
    Connected: "rebooted, applet brought and running",
    RunStarted: "EKF ready, run set up",
    RunFinished: "driven",
    LogSaved: "log fetched",
}


@dataclass(frozen=True)
class Job:
    """folder: of the session; events; seconds: (part, s it took); found: identified values by model."""

    folder: Path
    events: tuple[Event, ...]
    seconds: tuple[tuple[str, float], ...]
    found: dict[str, dict[str, float]]
    plan: SessionPlan


def plan_for(trigger: Trigger, simulation: SimulatedRover) -> SessionPlan:
    """The runs, on a rover as from the factory."""
    throttle = None if trigger == "pilot" else simulation.throttle_us
    settings = RunSettings(True, throttle, trigger, LIMITS)
    return SessionPlan(RUNS, settings, read(shipped("identification")), applet=applet_path())


def whole_job(binary: Path, folder: Path, trigger: Trigger = "override", physics: Physics = "plant") -> Job:
    """Install, drive, fetch, identify."""
    simulation = SimulatedRover("ardurover", binary, physics, prepared=False)
    plan = plan_for(trigger, simulation)
    session, began = folder / "session", time.monotonic()
    events, seconds = list[Event](), list[tuple[str, float]]()
    with ExitStack() as stack:
        rover = stack.enter_context(started(simulation, folder / "vehicle"))
        line = stack.enter_context(
            RecordedLine(conversation_in(_made(session)), about={"url": rover.connection})
        )
        told = stack.enter_context(pilot(rover, simulation.throttle_us))
        for event in drive(rover.connection, session, plan, line):
            if trigger == "pilot":
                told(event)
            events.append(event)
            if part := _PARTS.get(type(event)):
                seconds.append((part, time.monotonic() - began))
    found = _identified(
        events[-1], firmware_rover_text() if physics == "own" else rover_text("nominal"), folder
    )
    seconds.append(("identified", time.monotonic() - began))
    return Job(session, tuple(events), tuple(_differences(seconds)), found, plan)


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _differences(seconds: list[tuple[str, float]]) -> Iterator[tuple[str, float]]:
    for (_, before), (part, after) in itertools.pairwise([("", 0.0), *seconds]):
        yield part, after - before


def _identified(session: Any, rover: str, folder: Path) -> dict[str, dict[str, float]]:
    import rover_sweep as rs

    assert isinstance(session, SessionFinished)
    (folder / "rover.toml").write_text(rover)
    runs = rs.read(*map(str, session.logs), vehicle=str(folder / "rover.toml"))
    result = rs.identify(runs, bootstrap=0)
    return {name: {e.name: e.value for e in model.fit.estimates} for name, model in result.models.items()}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        job = whole_job(Path(sys.argv[1]), Path(place), *sys.argv[2:])  # type: ignore[arg-type]
        for part, took in job.seconds:
            print(f"{took:6.1f} s  {part}")
        print(f"{sum(took for _, took in job.seconds):6.1f} s  in all")
        for model, values in job.found.items():
            print(model, {name: round(value, 5) for name, value in values.items()})
