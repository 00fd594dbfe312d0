"""Runs driven on a simulated rover with factory settings, as `dry-run` drives them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rover_sweep.manoeuvre.sweep import Manoeuvre
from rover_sweep.session.content import SessionRun
from rover_sweep.session.simulated_rover import SimulatedRover, simulated_plan, simulated_session
from rover_sweep.vehicle.events import Event


def drive_simulated(
    runs: dict[str, Manoeuvre], folder: Path, variant: str | Path = "nominal", seed: int = 1
) -> Iterator[Event]:
    """The events of these runs on the embedded rover. runs: {name: manoeuvre}."""
    simulation = SimulatedRover(variant=variant, seed=seed, prepared=False)
    plan = simulated_plan(tuple(SessionRun(name, each) for name, each in runs.items()), simulation)
    with simulated_session(simulation, plan, folder) as (events, _):
        yield from events
