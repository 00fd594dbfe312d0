"""Two things at once, or something that no table has, while the laptop drives: the rover stops all the same.

Each returns the faults of a run; afterwards the rover must be disarmed or in HOLD, and near where it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from test_lost_laptop import FARTHEST, STEERING, held, metres_since, stick
from test_second_station import OTHER, SAME, command, each_step, once, override, parameter, station
from virtual_faults import asleep, hole, kill, power_lost, rc_lost, script_paused
from virtual_run import SETTINGS, played
from virtual_world import At, Fault, World

RESTART, SCRIPTING = 3, 42701
Faults = tuple[Fault, ...]


def set_by_other(name: str, value: float) -> Fault:
    return station(f"{name} {value:g}", once(parameter(name, value)), OTHER)


def releases() -> Fault:
    """Another station with our id gives all channels back to the radio, again and again."""
    return station("releases", override(chan1=0, chan3=0, chan6=0), SAME)


def noisy_steering() -> Fault:
    """A joystick of another station with our id moves the steering channel, as ours does."""

    def says(since: float) -> Any:
        us = [1500 + round(since * 50) % 7, 65535, 65535, 65535, 65535, 65535, 65535, 65535]
        return iter([dialect.MAVLink_rc_channels_override_message(1, 1, *us)])

    return station("joystick", says, SAME)


def scripts_restart() -> Fault:
    return station("restarts scripts", once(command(SCRIPTING, RESTART)), OTHER)


def jitters(around: int, channel: int) -> Fault:
    """A stick whose potentiometer is worn."""

    def shake(world: World) -> None:
        if world.vehicle.rover is not None:
            world.vehicle.rover.radio.transmitter[channel] = around + world.now_us // 20_000 % 5 - 2

    return each_step(f"RC{channel + 1} jitters", shake, float("inf"))


MOMENTS: dict[str, Callable[[], Faults]] = {
    "SWP_THR set to 0, killed": lambda: (set_by_other("SWP_THR", 0), stick(1800), kill()),
    "SWP_LAPSE set to 0, killed": lambda: (set_by_other("SWP_LAPSE", 0), stick(1800), kill()),
    "RC_OVERRIDE_TIME set to 0": lambda: (set_by_other("RC_OVERRIDE_TIME", 0), stick(1800)),
    "RC_OVERRIDE_TIME set to .2, killed": lambda: (
        set_by_other("RC_OVERRIDE_TIME", 0.2),
        *(jitters(1500, STEERING), stick(1800), kill()),
    ),
    "overrides released by another station": lambda: (stick(1800), releases()),
    "another station's joystick, killed": lambda: (noisy_steering(), stick(1800), kill()),
    "stick at the very throttle of the run, killed": lambda: (stick(1710), kill()),
    "worn sticks, killed": lambda: (jitters(1500, STEERING), jitters(1700, 2), kill()),
    "scripts restart, killed": lambda: (scripts_restart(), stick(1800), kill()),
    "script paused for .8 s, killed": lambda: (script_paused(0.8), stick(1800), kill()),
    "transmitter lost, killed": lambda: (rc_lost(1), kill()),
    "transmitter to preset values, killed": lambda: (rc_lost(2), kill()),
    "reboot, killed": lambda: (stick(1800), power_lost(3.0), kill()),
    "RC3_TRIM set to the throttle, killed": lambda: (set_by_other("RC3_TRIM", 1710), stick(1800), kill()),
    "RCMAP_THROTTLE set to another channel": lambda: (set_by_other("RCMAP_THROTTLE", 2), stick(1800, 1)),
    "asleep for 1.1 s, stick moved": lambda: (stick(1800), asleep(1.1, queues=False)),
    "hole of 1.1 s, stick moved": lambda: (stick(1800), hole(1.1)),
    "SYSID_MYGCS set to another id": lambda: (set_by_other("SYSID_MYGCS", 1), stick(1800)),
    "mode HOLD and MANUAL again by another station, killed": lambda: (
        station("modes", once(command(176, 1, 4), command(176, 1, 0)), OTHER),
        *(stick(1800), kill()),
    ),
}


@pytest.mark.parametrize("trigger", ["override", "aux"])
@pytest.mark.parametrize("name", MOMENTS)
def test_the_rover_stops_all_the_same(tmp_path: Path, name: str, trigger: Any) -> None:
    if trigger == "aux" and "releases" in name:
        pytest.skip("the switch is not overridden")
    settings = replace(SETTINGS, trigger=trigger)
    faults = [(At("sweep", 1.0), fault) for fault in MOMENTS[name]()]
    outcome = played(tmp_path, faults, settings=settings, limit=60.0, after=30.0, back=0.0)
    assert outcome.fired and outcome.unasked == 0
    metres = metres_since(outcome, outcome.world.entered["sweep"] * 1e-6 + 1.0)
    print(f"{name}, {trigger}: {metres:.1f} m; {outcome.record.texts[-1][1]}; {outcome.said[-90:]}")
    survives = outcome.finished is not None and outcome.finished.completed
    assert held(outcome) and (survives or metres <= FARTHEST)
