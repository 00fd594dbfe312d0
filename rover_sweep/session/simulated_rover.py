"""Starts a simulated rover: embedded, or the real firmware in SITL.

The firmware runs with our plant (ArduPilot's JSON interface) or with its own rover, which is kinematic: no
tyres, no roll, no servo lag, so that only its kinematics can be identified.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from firmware_params.applet_parameters import applet_path
from firmware_params.param_files import WantedParameter, read, shipped
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.manoeuvre.multisine import Multisine
from rover_sweep.manoeuvre.sweep import (
    FIRST_DOUBLET,
    FIRST_SWEEPS,
    BiasSweep,
    Doublet,
    Manoeuvre,
    Sweep,
    parameters_of,
    refuse_undersampled,
)
from rover_sweep.session.session import SessionPlan, SessionRun, drive
from rover_sweep.vehicle.events import Event, Interrupted, RunFinished, StateChanged, SwitchWanted
from rover_sweep.vehicle.link.connection import Access
from rover_sweep.vehicle.link.recorded_transport import RecordedLine, conversation_in
from rover_sweep.vehicle.run.controls import RunSettings

if TYPE_CHECKING:
    from sitl.launcher import Running

Simulator = Literal["embedded", "ardurover"]
Physics = Literal["plant", "own"]

# The nominal rover goes 2.5 m/s at 1710 us (sitl/plant/variants/nominal.toml), as in the recordings.
THROTTLE_US = 1710
OWN_THROTTLE_US = 1590  # 2.5 m/s of ArduPilot's own rover (4.6.3)
_SWITCH, _THROTTLE = 6, 3  # RC channels of the simulated pilot
_HIGH, _LOW, _CENTRE = 1900, 1000, 1500  # us


@dataclass(frozen=True)
class SimulatedRover:
    """A simulated rover. ardurover: path of the firmware's program (else environment, PATH).

    physics: of the firmware. variant: of the plant. prepared: with applet and parameters; otherwise it has
    factory settings, and both are installed over the link.
    """

    simulator: Simulator = "embedded"
    ardurover: Path | None = None
    physics: Physics = "plant"
    variant: str | Path = "nominal"
    seed: int = 1
    prepared: bool = True

    def __post_init__(self) -> None:
        if self.simulator == "embedded" and self.physics == "own":
            raise UsageError("only the real firmware has its own physics; give --vehicle ardurover")

    @property
    def throttle_us(self) -> int:
        """Throttle PWM of about 2.5 m/s."""
        return OWN_THROTTLE_US if self.physics == "own" else THROTTLE_US


@contextmanager
def started(simulation: SimulatedRover, home: Path) -> Iterator[Running]:
    """The rover, with its files in `home`, until the end of the block. LinkError if it does not start or ends
    early, then with its last output."""
    from sitl import launcher

    try:
        rover = _start(simulation, home)
    except launcher.LaunchError as error:
        raise LinkError(str(error)) from error
    with rover:
        try:
            yield rover
        except LinkError as error:
            if words := rover.last_words():
                raise LinkError(f"the simulated rover ended: {words}") from error
            raise


def _start(simulation: SimulatedRover, home: Path) -> Running:
    from sitl import launcher

    model: dict[str, Any] = {"variant": simulation.variant, "seed": simulation.seed}
    prepared = simulation.prepared
    if simulation.simulator == "embedded":
        options = ("--applet", "--parameter", "SCR_ENABLE=1") if prepared else ()
        return launcher.start_embedded(home, options=options, **model)
    defaults = [shipped("identification")] if prepared else []
    if simulation.physics == "own":
        model["variant"] = None
        defaults.append(_calibrated(home))
    scripts = [applet_path()] if prepared else []
    binary = launcher.find_ardurover(simulation.ardurover)
    return launcher.start_ardurover(binary, home, scripts=scripts, defaults=defaults, **model)


def _calibrated(home: Path) -> Path:
    """Write a parameter file of calibrated accelerometers: with its own rover the firmware does not arm
    without it (seen in 4.6.3), like a real rover, which its owner calibrates once. Values of ArduPilot's
    rover.parm."""
    home.mkdir(parents=True, exist_ok=True)
    path = home / "calibrated.param"
    lines = (
        f"INS_ACC{n}{what}_{axis} {value}\n"
        for n in ("", "2")
        for what, value in (("OFFS", 0.001), ("SCAL", 1.001))
        for axis in "XYZ"
    )
    path.write_text("".join(lines), encoding="ascii")
    return path


@contextmanager
def pilot(rover: Running, throttle_us: int) -> Iterator[Callable[[Event], None]]:
    """A simulated pilot. Pass each event of a session to the yielded function: it throws switch 6 and holds
    the throttle stick.

    UsageError if the rover has no radio. At the end the sticks are at rest.
    """
    from sitl.transmitter import Transmitter

    if rover.radio is None:
        raise UsageError("the embedded rover has no radio to throw switch 6; give override or aux")
    transmitter = Transmitter(rover.radio)

    def react(event: Event) -> None:
        if isinstance(event, SwitchWanted):
            transmitter.hold(_SWITCH, _HIGH if event.position == "high" else _LOW)
        elif isinstance(event, StateChanged):
            transmitter.hold(_THROTTLE, throttle_us if 2 <= event.state <= 8 else _CENTRE)
        elif isinstance(event, RunFinished | Interrupted):
            transmitter.hold(_THROTTLE, _CENTRE)
            transmitter.hold(_SWITCH, _LOW)

    try:
        yield react
    finally:
        transmitter.close()


# The dry run up to the recordings: two sweeps, a doublet and optional manoeuvres on a simulated rover, or on
# a vehicle that is already running.
#
# It arms and drives without asking. On a vehicle at `url` it does so only with `consent`.


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

    sweeps: tuple[Sweep, ...] = FIRST_SWEEPS
    multisines: tuple[Multisine, ...] = ()
    bias_sweeps: tuple[BiasSweep, ...] = ()
    doublet: Doublet = FIRST_DOUBLET
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
