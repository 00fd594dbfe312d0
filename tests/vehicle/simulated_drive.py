"""Runs driven on a simulated rover, as `dry-run` drives them; options of one that is set up."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from firmware_params.param_files import read, shipped
from rover_sweep.manoeuvre.sweep import Manoeuvre
from rover_sweep.session.content import SessionRun
from rover_sweep.session.simulated_rover import SimulatedRover, simulated_plan, simulated_session
from rover_sweep.vehicle.events import Event

PARAMETERS = tuple(f"--parameter={p.name}={p.value:g}" for p in read(shipped("identification")))
READY = ("--applet", *PARAMETERS)  # options of a rover that has what an identification needs


def drive_simulated(
    runs: dict[str, Manoeuvre], folder: Path, variant: str | Path = "nominal", seed: int = 1
) -> Iterator[Event]:
    """The events of these runs on the embedded rover. runs: {name: manoeuvre}."""
    simulation = SimulatedRover(variant=variant, seed=seed, prepared=False)
    plan = simulated_plan(tuple(SessionRun(name, each) for name, each in runs.items()), simulation)
    with simulated_session(simulation, plan, folder) as (events, _):
        yield from events
