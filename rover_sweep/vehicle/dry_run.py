"""The dry run up to the recordings: two sweeps and a doublet on a simulated rover, or on any that runs.

It arms and drives by itself, which is what a simulated rover is for. On a vehicle behind `url` it
does so only when told that this is wanted (`consent`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from firmware_params.check import WantedParameter, read, shipped
from firmware_params.parameters import applet_path
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.identify.sweep import Doublet, Sweep
from rover_sweep.vehicle.events import Event
from rover_sweep.vehicle.run import RunSettings
from rover_sweep.vehicle.session import Plan, PlannedRun, drive

Simulator = Literal["embedded", "ardurover"]

# The nominal rover goes 2.5 m/s at 1710 us (sitl/variants/nominal.toml), as in the recordings.
THROTTLE_US = 1710


@dataclass(frozen=True)
class DryRun:
    """What to drive, and on what.

    simulator: the embedded rover or the real firmware (`ardurover`: its path, else environment or
    PATH). url: a vehicle that runs already, instead; it is armed and driven only with `consent`.
    sweeps, doublet: the manoeuvres; the doublet is for verification. limits: of the applet.
    parameters: set on the vehicle beforehand where they differ.
    """

    sweeps: tuple[Sweep, ...] = (Sweep(amplitude=120.0), Sweep(amplitude=240.0))
    doublet: Doublet = field(default_factory=Doublet)
    simulator: Simulator = "embedded"
    ardurover: Path | None = None
    variant: str | Path = "nominal"
    seed: int = 1
    url: str | None = None
    consent: bool = False
    throttle_us: int = THROTTLE_US
    limits: dict[str, float] = field(default_factory=lambda: {"gcs": 1.0, "v_min": 1.0, "v_max": 5.0})
    parameters: tuple[WantedParameter, ...] = field(default_factory=lambda: read(shipped("identification")))

    @property
    def plan(self) -> Plan:
        """As a session."""
        sweeps = (PlannedRun(f"sweep{n}", sweep) for n, sweep in enumerate(self.sweeps, 1))
        return Plan(
            runs=(*sweeps, PlannedRun("doublet", self.doublet)),
            settings=RunSettings(
                arm=True, throttle_us=self.throttle_us, trigger="override", extra=self.limits
            ),
            parameters=self.parameters,
            applet=applet_path(),
        )


def dry_run(settings: DryRun, folder: Path) -> Iterator[Event]:
    """Drive all of it into `folder` (see `session`). Yields events; after each RunFinished the run's
    recording is complete and may be judged before the next is asked for."""
    if settings.url is not None and not settings.consent:
        raise UsageError(
            f"the dry run arms and drives the vehicle on {settings.url} by itself; say so if that is wanted, "
            "with its wheels off the ground or on a free field"
        )
    with _vehicle(settings, folder) as url:
        yield from drive(url, folder, settings.plan)


@contextmanager
def _vehicle(settings: DryRun, folder: Path) -> Iterator[str]:
    """The URL of a vehicle that runs meanwhile."""
    if settings.url is not None:
        yield settings.url
        return
    from sitl import launcher

    home = folder / "vehicle"
    model: dict[str, Any] = {"variant": settings.variant, "seed": settings.seed}
    try:
        if settings.simulator == "embedded":
            rover = launcher.start_embedded(
                home, options=("--applet", "--parameter", "SCR_ENABLE=1"), **model
            )
        else:
            binary = launcher.find_ardurover(settings.ardurover)
            rover = launcher.start_ardurover(
                binary, home, scripts=[applet_path()], defaults=[shipped("identification")], **model
            )
    except launcher.LaunchError as error:
        raise LinkError(str(error)) from error
    with rover:
        yield rover.connection
