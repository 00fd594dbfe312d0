"""How long the official firmware takes to give the steering back, by each way to end a sweep.

The delay is on the firmware's clock: from the last message before the act to the last servo output that is
not the pilot's. Measured in SITL on 4.6.3: see the limits below, which are half as much again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from firmware_params.applet_parameters import applet_path
from firmware_params.param_files import shipped
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.session.session import await_estimator, start_streams
from rover_sweep.vehicle.events import Sample, StateChanged, SwitchWanted
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import constant, kind
from rover_sweep.vehicle.run.controls import RunSettings, Trigger, pump
from rover_sweep.vehicle.run.one_run import one_run
from sitl.launcher import start_ardurover
from sitl.transmitter import Transmitter

pytestmark = pytest.mark.ardurover

SWEEP = Sweep(amplitude=150, w_min=3, w_max=20, t_rec=30, fade=0.5, dwell=0.5, straight=0.5)
LIMITS = {"gcs": 1.0, "v_min": 0.5, "v_max": 5.0, "still": 0.0}
LOW, HIGH, CENTRE, DRIVING = 1000, 1900, 1500, 1710  # us
STEERING, THROTTLE, SWITCH = 1, 3, 6
INTO = 2.0  # s of the sweep before the act


@dataclass
class Rover:
    """A rover that is set up, with a link and a transmitter; `steering` holds (t [s], servo 1 [us])."""

    link: Link
    radio: Transmitter
    steering: list[tuple[float, int]] = field(default_factory=list)
    silence: float = 0.0  # s that nobody reads or sends after the act

    def hear(self, message: Any) -> None:
        if kind(message) == "SERVO_OUTPUT_RAW":
            self.steering.append((message.time_usec * 1e-6, message.servo1_raw))

    def command(self, name: str, *params: float) -> None:
        values = {f"param{i}": params[i - 1] if i <= len(params) else 0.0 for i in range(1, 8)}
        self.link.to_vehicle("COMMAND_LONG", command=constant(name), confirmation=0, **values)


@pytest.fixture(scope="module")
def rover(ardurover: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rover]:
    home = tmp_path_factory.mktemp("rover")
    defaults = [shipped("identification")]
    with (
        start_ardurover(ardurover, home, defaults=defaults, scripts=[applet_path()]) as running,
        Link.open(running.connection, home / "connect.tlog", timeout=60.0) as link,
    ):
        list(start_streams(link))
        list(await_estimator(link))
        assert running.radio is not None
        rover = Rover(link, Transmitter(running.radio))
        with link.listening(rover.hear):
            yield rover
        rover.radio.close()


def driven_until(rover: Rover, tlog: Path, trigger: Trigger, act: Callable[[Rover], None]) -> float:
    """Drive a sweep and act INTO it; the vehicle's time of the act [s]. The pilot drives where he throws."""
    pilot = trigger == "pilot"
    settings = RunSettings(True, None if pilot else DRIVING, trigger, LIMITS)
    events = one_run(rover.link, SWEEP, "stopped", tlog, settings)
    since, acted = float("inf"), 0.0
    for event in events:
        if isinstance(event, SwitchWanted) and pilot:
            rover.radio.hold(SWITCH, HIGH if event.position == "high" else LOW)
        if isinstance(event, StateChanged):
            since = event.t if event.state == 6 else since
            if pilot:
                rover.radio.hold(THROTTLE, DRIVING if 2 <= event.state <= 8 else CENTRE)
        if isinstance(event, Sample) and event.t > since + INTO and not acted:
            acted = rover.link.clock.now
            try:
                act(rover)
            except KeyboardInterrupt as stop:
                with pytest.raises(KeyboardInterrupt):
                    events.throw(stop)
    pump(rover.link, 1.0)  # the pilot's stick stays where it is until the steering was looked at
    for channel in (STEERING, THROTTLE):
        rover.radio.hold(channel, CENTRE)
    assert acted
    return acted


def switch_low(rover: Rover) -> None:
    rover.radio.hold(SWITCH, LOW)


def stick_moved(rover: Rover) -> None:
    rover.radio.hold(STEERING, 1750)  # the applet takes more than 200 us off trim for the pilot


def aux_low(rover: Rover) -> None:
    rover.command("MAV_CMD_DO_AUX_FUNCTION", 300.0, 0.0)


def disarm(rover: Rover) -> None:
    rover.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0, 21196.0)


def hold_mode(rover: Rover) -> None:
    rover.command("MAV_CMD_DO_SET_MODE", 1.0, 4.0)


def ctrl_c(rover: Rover) -> None:
    raise KeyboardInterrupt


def laptop_gone(rover: Rover) -> None:
    time.sleep(5.0)


@pytest.mark.parametrize(
    ("act", "trigger", "within"),
    [
        (switch_low, "pilot", 0.6),
        (stick_moved, "pilot", 0.3),
        (aux_low, "aux", 0.3),
        (disarm, "pilot", 0.3),
        (hold_mode, "pilot", 0.3),
        (ctrl_c, "override", 0.6),
        (laptop_gone, "override", 3.6),
    ],
)
def test_the_steering_is_back(
    rover: Rover, tmp_path: Path, act: Callable[[Rover], None], trigger: Trigger, within: float
) -> None:
    rover.steering.clear()
    acted = driven_until(rover, tmp_path / "stopped.tlog", trigger, act)
    pump(rover.link, 1.0)
    swept = [pwm for t, pwm in rover.steering if t < acted]
    after = [(t - acted, pwm) for t, pwm in rover.steering if t > acted]
    assert max(swept) - min(swept) > 100  # it was sweeping
    settled = [pwm for t, pwm in after if within < t < within + 0.5]
    assert settled and max(settled) - min(settled) <= 2
    late = max((t for t, pwm in after if t < within and abs(pwm - settled[0]) > 2), default=0.0)
    print(f"\n{act.__name__}: steering back after {late:.2f} s")
    rover.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0, 21196.0)
    rover.command("MAV_CMD_DO_SET_MODE", 1.0, 0.0)
    rover.link.wait_for("HEARTBEAT", 4.0, lambda _: not rover.link.armed)
