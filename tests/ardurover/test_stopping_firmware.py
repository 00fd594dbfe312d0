"""How long the official firmware takes to give steering or motor back, by each way to end a sweep.

The delay is on the firmware's clock: from the last message before the act to the last servo output that is
not the pilot's (of a motor: neither the pilot's throttle nor neutral). Measured in SITL on 4.6.3: see the
limits below, which are half as much again.
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
from rover_sweep.manoeuvre.sweep import Sweep, ThrottleSweep
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
THROTTLE_SWEEP = ThrottleSweep(amplitude=60, w_min=3, w_max=8, t_rec=30, fade=0.5, dwell=0.5, straight=0.5)
LIMITS = {"gcs": 1.0, "v_min": 0.5, "v_max": 5.0, "still": 0.0}
LOW, HIGH, CENTRE, DRIVING = 1000, 1900, 1500, 1710  # us
STEERING, THROTTLE, SWITCH = 1, 3, 6
INTO = 2.0  # s of the sweep before the act


@dataclass
class Rover:
    """A rover that is set up, with a link and a transmitter; `sent` holds (t [s], servo 1, servo 3 [us])."""

    link: Link
    radio: Transmitter
    sent: list[tuple[float, int, int]] = field(default_factory=list)

    def hear(self, message: Any) -> None:
        if kind(message) == "SERVO_OUTPUT_RAW":
            self.sent.append((message.time_usec * 1e-6, message.servo1_raw, message.servo3_raw))

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


def driven_until(
    rover: Rover, sweep: Sweep | ThrottleSweep, tlog: Path, trigger: Trigger, act: Callable[[Rover], None]
) -> float:
    """Drive a sweep and act INTO it; the vehicle's time of the act [s]. The pilot drives where he throws."""
    pilot, of_motor = trigger == "pilot", isinstance(sweep, ThrottleSweep)
    settings = RunSettings(True, None if pilot else DRIVING, trigger, LIMITS)
    events = one_run(rover.link, sweep, "stopped", tlog, settings)
    since, acted = float("inf"), 0.0
    for event in events:
        if isinstance(event, SwitchWanted) and pilot:
            rover.radio.hold(SWITCH, HIGH if event.position == "high" else LOW)
        if isinstance(event, StateChanged):
            since = event.t if event.state == 6 else since
            if pilot and not (of_motor and acted):
                rover.radio.hold(THROTTLE, DRIVING if 2 <= event.state <= 8 else CENTRE)
        if isinstance(event, Sample) and event.t > since + INTO and not acted:
            acted = rover.link.clock.now
            try:
                act(rover)
            except KeyboardInterrupt as stop:
                with pytest.raises(KeyboardInterrupt):
                    events.throw(stop)
    pump(rover.link, 1.0)  # the pilot's stick stays where it is until the output was looked at
    for channel in (STEERING, THROTTLE):
        rover.radio.hold(channel, CENTRE)
    assert acted
    return acted


def settled_after(rover: Rover, servo: int, acted: float, within: float, least: int) -> tuple[int, float]:
    """(where the output rests from `within` [s] on, when it last was elsewhere [s]); servo: 1 or 3.

    least: us by which it moved in the INTO seconds before.
    """
    pump(rover.link, 1.0)
    output = [(row[0] - acted, row[1 if servo == 1 else 2]) for row in rover.sent]
    swept = [pwm for t, pwm in output if -INTO < t < 0]
    assert max(swept) - min(swept) > least  # it was sweeping
    settled = [pwm for t, pwm in output if within < t < within + 0.5]
    assert settled and max(settled) - min(settled) <= 2
    late = (t for t, pwm in output if 0 < t < within and abs(pwm - settled[0]) > 2)
    return settled[0], max(late, default=0.0)


def at_rest(rover: Rover) -> None:
    rover.radio.hold(SWITCH, LOW)
    rover.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0, 21196.0)
    rover.command("MAV_CMD_DO_SET_MODE", 1.0, 0.0)
    rover.link.wait_for("HEARTBEAT", 4.0, lambda _: not rover.link.armed)


def switch_low(rover: Rover) -> None:
    rover.radio.hold(SWITCH, LOW)


def stick_moved(rover: Rover) -> None:
    rover.radio.hold(STEERING, 1750)  # the applet takes more than 200 us off trim for the pilot


def throttle_back(rover: Rover) -> None:
    rover.radio.hold(THROTTLE, CENTRE)


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
    rover.sent.clear()
    acted = driven_until(rover, SWEEP, tmp_path / "stopped.tlog", trigger, act)
    _, late = settled_after(rover, 1, acted, within, 100)
    print(f"\n{act.__name__}: steering back after {late:.2f} s")
    at_rest(rover)


@pytest.mark.parametrize(
    ("act", "trigger", "within"),
    [
        (switch_low, "pilot", 0.8),
        (throttle_back, "pilot", 0.5),
        (disarm, "pilot", 0.3),
        (hold_mode, "pilot", 1.0),
        (ctrl_c, "override", 0.8),
        (laptop_gone, "override", 3.6),
    ],
)
def test_the_motor_is_back(
    rover: Rover, tmp_path: Path, act: Callable[[Rover], None], trigger: Trigger, within: float
) -> None:
    rover.sent.clear()
    acted = driven_until(rover, THROTTLE_SWEEP, tmp_path / "stopped.tlog", trigger, act)
    settled, late = settled_after(rover, 3, acted, within, 80)
    print(f"\n{act.__name__}: motor at {settled} us, back after {late:.2f} s")
    if act is not switch_low:  # the pilot still drives after the switch
        assert settled in (0, CENTRE)
    at_rest(rover)
