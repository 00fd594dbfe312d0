"""`investigate --vehicle embedded|ardurover`: an investigation of a simulated rover, without asking."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rover_sweep.errors import UsageError

if TYPE_CHECKING:
    from rover_sweep.api.investigation import Bounds
    from rover_sweep.cli.driving.one_by_one import OneByOne
    from rover_sweep.data.vehicle_file import Vehicle
    from rover_sweep.session.simulated_rover import SimulatedRover

_LIMITS = {"gcs": 1.0, "v_min": 0.6, "v_max": 5.0}
SPEED = 2.5  # m/s at the throttle of a simulated rover


def investigate_simulated(
    simulator: str,
    bounds: Bounds,
    limits: dict[str, float],
    logs: bool,
    out: str | None,
    as_json: bool,
    *,
    physics: str,
    ardurover: str | None,
    variant: str,
    seed: int,
    rover_file: str | None,
) -> None:
    """Start the simulated rover, install applet and parameters, and investigate it.

    UsageError for the firmware's own physics, which has no tyres and no roll.
    """
    from rover_sweep.cli.driving.investigating import show_investigation
    from rover_sweep.cli.driving.simulated_vehicle import rover_text, vehicle_in
    from rover_sweep.cli.types.folders import session_folder
    from rover_sweep.session.simulated_rover import SimulatedRover

    if physics == "own":
        raise UsageError("the firmware's own rover is kinematic: there is nothing to investigate")
    simulation = SimulatedRover(
        "ardurover" if simulator == "ardurover" else "embedded",
        Path(ardurover) if ardurover else None,
        "plant",
        variant,
        seed,
        prepared=False,
    )
    text = None if rover_file else rover_text(variant)
    folder = session_folder(out, "investigation", also=() if rover_file else ("rover.toml",))
    rover = vehicle_in(folder, rover_file, text)
    allowed = replace(bounds, speed=min(bounds.speed, SPEED), headings=False)
    with simulated_driver(simulation, folder, rover, limits, logs) as driver:
        show_investigation(driver, rover, allowed, folder, as_json)


@contextmanager
def simulated_driver(
    simulation: SimulatedRover,
    folder: Path,
    rover: tuple[Vehicle, Path],
    limits: dict[str, float],
    logs: bool,
) -> Iterator[OneByOne]:
    """A driver of a simulated rover, which runs inside the block. It does not ask."""
    from firmware_params.applet_parameters import applet_path
    from firmware_params.param_files import read, shipped
    from rover_sweep.cli.driving.one_by_one import OneByOne
    from rover_sweep.session.session import SessionPlan
    from rover_sweep.session.simulated_rover import started
    from rover_sweep.vehicle.run.settings import RunSettings

    settings = RunSettings(True, simulation.throttle_us, "override", {"pwm_max": 250.0} | _LIMITS | limits)
    plan = SessionPlan((), settings, read(shipped("identification")), applet=applet_path(), logs=logs)
    with started(simulation, folder / "vehicle") as running:
        yield OneByOne(running.connection, folder, rover, plan, SPEED, None)
