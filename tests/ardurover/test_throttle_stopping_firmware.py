"""How long the official firmware takes to give the motor back, by each way to end a throttle sweep.

The delay is on the firmware's clock: from the last message before the act to the last servo output that is
neither the pilot's throttle nor neutral.
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
from rover_sweep.manoeuvre.sweep import ThrottleSweep
from rover_sweep.session.session import await_estimator, start_streams
from rover_sweep.vehicle.events import Sample, StateChanged, SwitchWanted
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.link.mavlink import constant, kind
from rover_sweep.vehicle.run.controls import RunSettings, Trigger, pump
from rover_sweep.vehicle.run.one_run import one_run
from sitl.launcher import start_ardurover
from sitl.transmitter import Transmitter

pytestmark = pytest.mark.ardurover

SWEEP = ThrottleSweep(amplitude=60, w_min=3, w_max=8, t_rec=30, fade=0.5, dwell=0.5, straight=0.5)
LIMITS = {"gcs": 1.0, "v_min": 0.5, "v_max": 5.0, "still": 0.0}
LOW, HIGH, NEUTRAL, DRIVING = 1000, 1900, 1500, 1710  # us
THROTTLE, SWITCH = 3, 6
INTO = 2.0  # s of the sweep before the act


@dataclass
class Motor:
    """A rover that is set up; `sent` holds (t [s], servo 3 [us])."""

    link: Link
    radio: Transmitter
    sent: list[tuple[float, int]] = field(default_factory=list)

    def hear(self, message: Any) -> None:
        if kind(message) == "SERVO_OUTPUT_RAW":
            self.sent.append((message.time_usec * 1e-6, message.servo3_raw))

    def command(self, name: str, *params: float) -> None:
        values = {f"param{i}": params[i - 1] if i <= len(params) else 0.0 for i in range(1, 8)}
        self.link.to_vehicle("COMMAND_LONG", command=constant(name), confirmation=0, **values)


@pytest.fixture(scope="module")
def motor(ardurover: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Motor]:
    home = tmp_path_factory.mktemp("rover")
    defaults = [shipped("identification")]
    with (
        start_ardurover(ardurover, home, defaults=defaults, scripts=[applet_path()]) as running,
        Link.open(running.connection, home / "connect.tlog", timeout=60.0) as link,
    ):
        list(start_streams(link))
        list(await_estimator(link))
        assert running.radio is not None
        motor = Motor(link, Transmitter(running.radio))
        with link.listening(motor.hear):
            yield motor
        motor.radio.close()


def switch_low(motor: Motor) -> None:
    motor.radio.hold(SWITCH, LOW)


def stick_back(motor: Motor) -> None:
    motor.radio.hold(THROTTLE, NEUTRAL)


def disarm(motor: Motor) -> None:
    motor.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0, 21196.0)


def hold_mode(motor: Motor) -> None:
    motor.command("MAV_CMD_DO_SET_MODE", 1.0, 4.0)


def ctrl_c(motor: Motor) -> None:
    raise KeyboardInterrupt


def laptop_gone(motor: Motor) -> None:
    time.sleep(5.0)


def driven_until(motor: Motor, tlog: Path, trigger: Trigger, act: Callable[[Motor], None]) -> float:
    """Drive a throttle sweep and act INTO it; the vehicle's time of the act [s]."""
    pilot = trigger == "pilot"
    events = one_run(
        motor.link, SWEEP, "stopped", tlog, RunSettings(True, None if pilot else DRIVING, trigger, LIMITS)
    )
    since, acted = float("inf"), 0.0
    for event in events:
        if isinstance(event, SwitchWanted) and pilot:
            motor.radio.hold(SWITCH, HIGH if event.position == "high" else LOW)
        if isinstance(event, StateChanged):
            since = event.t if event.state == 6 else since
            if pilot and not acted:
                motor.radio.hold(THROTTLE, DRIVING if 2 <= event.state <= 8 else NEUTRAL)
        if isinstance(event, Sample) and event.t > since + INTO and not acted:
            acted = motor.link.clock.now
            try:
                act(motor)
            except KeyboardInterrupt as stop:
                with pytest.raises(KeyboardInterrupt):
                    events.throw(stop)
    pump(motor.link, 1.0)
    motor.radio.hold(THROTTLE, NEUTRAL)
    assert acted
    return acted


@pytest.mark.parametrize(
    ("act", "trigger", "within"),
    [
        (switch_low, "pilot", 0.8),
        (stick_back, "pilot", 0.5),
        (disarm, "pilot", 0.3),
        (hold_mode, "pilot", 1.0),
        (ctrl_c, "override", 0.8),
        (laptop_gone, "override", 3.6),
    ],
)
def test_the_motor_is_back(
    motor: Motor, tmp_path: Path, act: Callable[[Motor], None], trigger: Trigger, within: float
) -> None:
    motor.sent.clear()
    acted = driven_until(motor, tmp_path / "stopped.tlog", trigger, act)
    pump(motor.link, 1.0)
    swept = [pwm for t, pwm in motor.sent if acted - INTO < t < acted]
    after = [(t - acted, pwm) for t, pwm in motor.sent if t > acted]
    assert max(swept) - min(swept) > 80  # it was sweeping
    settled = [pwm for t, pwm in after if within < t < within + 0.5]
    assert settled and max(settled) - min(settled) <= 2
    late = max((t for t, pwm in after if t < within and abs(pwm - settled[0]) > 2), default=0.0)
    print(f"\n{act.__name__}: motor at {settled[0]} us, back after {late:.2f} s")
    if act is not switch_low:  # the pilot still drives after the switch
        assert settled[0] in (0, NEUTRAL)
    motor.radio.hold(SWITCH, LOW)
    motor.command("MAV_CMD_COMPONENT_ARM_DISARM", 0.0, 21196.0)
    motor.command("MAV_CMD_DO_SET_MODE", 1.0, 0.0)
    motor.link.wait_for("HEARTBEAT", 4.0, lambda _: not motor.link.armed)
