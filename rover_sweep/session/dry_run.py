"""The dry run up to the recordings: two sweeps, a doublet and optional manoeuvres on a simulated rover, or on
a vehicle that is already running.

It arms and drives without asking. On a vehicle at `url` it does so only with `consent`.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from firmware_params.applet_parameters import applet_path
from firmware_params.param_files import WantedParameter, read, shipped
from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.applet_values import parameters_of, refuse_undersampled
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import BiasSweep, Doublet, Manoeuvre, Sweep
from rover_sweep.session.session import SessionPlan, SessionRun, drive
from rover_sweep.session.simulated_rover import THROTTLE_US, SimulatedRover, Simulator, started
from rover_sweep.vehicle.events import Event
from rover_sweep.vehicle.link.access import Access
from rover_sweep.vehicle.link.recorded_transport import RecordedLine, conversation_in
from rover_sweep.vehicle.run.settings import RunSettings

STEERING_US = 400.0  # SERVO1_MIN and SERVO1_MAX, 1100 and 1900 us, about the trim
_PWM_MAX = 250.0  # default of SWP_PWM_MAX, us
_FACTORY_LOOP_RATE = 50.0  # Hz, default of SCHED_LOOP_RATE


@dataclass(frozen=True)
class DryRun:
    """The manoeuvres and the rover of a dry run.

    simulator: the embedded rover or the real firmware (`ardurover`: its path, else environment or
    PATH). url: use this running vehicle instead; it is armed and driven only with `consent`.
    sweeps, multisines, bias_sweeps, doublet: the manoeuvres in this order; the doublet is for verification.
    throttle_us [us]. limits: of the applet. parameters: set on the vehicle beforehand if they differ.
    """

    sweeps: tuple[Sweep, ...] = (Sweep(amplitude=120.0), Sweep(amplitude=240.0))
    multisines: tuple[Multisine, ...] = ()
    bias_sweeps: tuple[BiasSweep, ...] = ()
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
    def plan(self) -> SessionPlan:
        """The plan of its session. On a simulated rover SWP_PWM_MAX allows every amplitude.

        UsageError without consent, and for settings that would fail later: numbers that the applet refuses,
        amplitudes beyond the simulated steering, frequencies too high for the loop rate.
        """
        if self.url is not None and not self.consent:
            raise UsageError(
                f"the dry run arms and drives the vehicle on {self.url} without asking; allow that with "
                "--arm-and-drive, and put its wheels off the ground or the rover on a free field"
            )
        runs = (
            *_numbered("sweep", self.sweeps),
            *_numbered("multisine", self.multisines),
            *_numbered("bias-sweep", self.bias_sweeps),
            SessionRun("doublet", self.doublet),
        )
        limits = self.limits
        if self.url is None:
            amplitude = max(run.manoeuvre.peak for run in runs)
            _refuse_amplitude(amplitude)
            limits = {"pwm_max": max(_PWM_MAX, amplitude)} | limits
        for run in runs:
            parameters_of(run.manoeuvre, **limits)
            refuse_undersampled(run.manoeuvre, _loop_rate(self.parameters))
        return SessionPlan(
            runs=runs,
            settings=RunSettings(arm=True, throttle_us=self.throttle_us, trigger="override", extra=limits),
            parameters=self.parameters,
            applet=applet_path(),
        )


def dry_run(settings: DryRun, folder: Path, access: Access | None = None) -> Generator[Event, None, None]:
    """Drive the plan and record into `folder` (see `session`). Yields events; after each RunFinished the
    recording of the run is complete and can be judged before the next event. access: see `Link.open`."""
    plan = settings.plan
    with _vehicle(settings, folder) as url, RecordedLine(conversation_in(folder)) as line:
        yield from drive(url, folder, plan, line, access=access)


def _numbered(name: str, manoeuvres: Sequence[Manoeuvre]) -> Iterator[SessionRun]:
    return (SessionRun(f"{name}{n}", manoeuvre) for n, manoeuvre in enumerate(manoeuvres, 1))


def _refuse_amplitude(amplitude: float) -> None:
    if amplitude > STEERING_US:
        raise UsageError(
            f"a run of {amplitude:g} us exceeds the {STEERING_US:g} us that the simulated steering moves "
            "to each side; give less"
        )


def _loop_rate(parameters: tuple[WantedParameter, ...]) -> float:
    return next((p.value for p in parameters if p.name == "SCHED_LOOP_RATE"), _FACTORY_LOOP_RATE)


@contextmanager
def _vehicle(settings: DryRun, folder: Path) -> Iterator[str]:
    """The URL of a vehicle that runs inside the block."""
    if settings.url is not None:
        yield settings.url
        return
    simulation = SimulatedRover(
        settings.simulator, settings.ardurover, variant=settings.variant, seed=settings.seed
    )
    with started(simulation, folder / "vehicle") as rover:
        yield rover.connection
