"""Starts a simulated rover: embedded, or the real firmware in SITL.

The firmware runs with our plant (ArduPilot's JSON interface) or with its own rover, which is kinematic: no
tyres, no roll, no servo lag, so that only its kinematics can be identified.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from firmware_params.applet_parameters import applet_path
from firmware_params.param_files import read, shipped
from rover_sweep.errors import LinkError, UsageError
from rover_sweep.manoeuvre.sweep import parameters_of, refuse_undersampled
from rover_sweep.session.content import SessionRun
from rover_sweep.session.session import SessionPlan, drive
from rover_sweep.vehicle.events import Event, Interrupted, RunFinished, StateChanged, SwitchWanted
from rover_sweep.vehicle.link.recorded_transport import RecordedLine, conversation_in
from rover_sweep.vehicle.run.controls import RunSettings, Trigger

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
            raise UsageError("only the real firmware has its own physics; give --simulator ardurover")

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


# A session on a simulated rover, which this program arms and drives without asking.


STEERING_US = 400.0  # SERVO1_MIN and SERVO1_MAX, 1100 and 1900 us, about the trim
_PWM_MAX = 250.0  # default of SWP_PWM_MAX, us


def simulated_plan(
    runs: tuple[SessionRun, ...],
    simulation: SimulatedRover,
    trigger: Trigger = "override",
    limits: Mapping[str, float] = MappingProxyType({}),
    logs: bool = True,
) -> SessionPlan:
    """The plan of these runs: applet and parameters are installed, SWP_PWM_MAX allows every amplitude.

    limits: of the applet. UsageError for settings that would fail later: numbers that the applet refuses,
    amplitudes beyond the simulated steering, frequencies too high for the loop rate, a pilot without a radio.
    """
    if trigger == "pilot" and simulation.simulator == "embedded":
        raise UsageError("the embedded rover has no radio for switch 6; use --throw-switch override or aux")
    parameters = read(shipped("identification"))
    highest = max((run.manoeuvre.peak for run in runs), default=0.0)
    extra = {"pwm_max": max(_PWM_MAX, highest), "gcs": 1.0, "v_min": 1.0, "v_max": 5.0, **limits}
    for run in runs:
        parameters_of(run.manoeuvre, **extra)
        refuse_undersampled(run.manoeuvre, next(p.value for p in parameters if p.name == "SCHED_LOOP_RATE"))
    if highest > STEERING_US:
        raise UsageError(
            f"a run of {highest:g} us exceeds the {STEERING_US:g} us that the simulated steering moves "
            "to each side; give less"
        )
    throttle = None if trigger == "pilot" else simulation.throttle_us
    settings = RunSettings(True, throttle, trigger, extra)
    return SessionPlan(runs, settings, parameters, applet=applet_path(), logs=logs)


@contextmanager
def simulated_session(
    simulation: SimulatedRover, plan: SessionPlan, folder: Path
) -> Iterator[tuple[Generator[Event, None, None], Callable[[Event], None]]]:
    """(events of the plan driven on the rover, see `drive`; what its pilot does after each event).

    The rover runs until the end of the block.
    """
    with started(simulation, folder / "vehicle") as rover, RecordedLine(conversation_in(folder)) as line:
        events = drive(rover.connection, folder, plan, line)
        if plan.settings.trigger != "pilot":
            yield events, lambda event: None
            return
        with pilot(rover, simulation.throttle_us) as follow:
            yield events, follow
