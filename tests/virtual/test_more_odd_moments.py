"""Rovers set up unlike that of the other tests: the laptop is lost in mid run, and they stop all the same."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from unittest import mock

import pytest
from test_lost_laptop import FARTHEST, held, metres_since, stick
from test_odd_moments import set_by_other
from virtual_faults import kill
from virtual_line import VirtualLine
from virtual_run import BOOT, SETTINGS, SWEEP, Happening, Outcome, _outcome, played, start_streams
from virtual_world import MONOTONIC_0, At, Fault, World

from rover_sweep.errors import UsageError
from rover_sweep.manoeuvre.sweep import Manoeuvre, ThrottleSweep
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.run.one_run import one_run

WRAP_US = 2**32
SWITCH_7 = {"RC6_OPTION": 0.0}
OTHER_STICKS = {"RCMAP_ROLL": 4.0, "RCMAP_THROTTLE": 2.0, "RCMAP_YAW": 1.0, "RCMAP_PITCH": 3.0}
OVER_THROTTLE = ThrottleSweep(amplitude=60, w_min=3, w_max=12, t_rec=8, fade=0.5, dwell=0.5, straight=1)


@dataclass(frozen=True)
class Setup:
    """parameters: before the boot; later: once the applet runs; throttle: RC channel of the stick, 0-based;
    age_us: vehicle's clock at the start."""

    parameters: dict[str, float] = field(default_factory=dict)
    later: dict[str, float] = field(default_factory=dict)
    throttle: int = 2
    throttle_us: int = 1710
    trim: int = 1500
    manoeuvre: Manoeuvre = SWEEP
    age_us: int = 0


SETUPS = {
    "other sticks, SWP_CHAN 7": Setup(SWITCH_7 | OTHER_STICKS, {"SWP_CHAN": 7.0}, throttle=1),
    "no dead zones": Setup({"RC1_DZ": 0.0, "RC3_DZ": 0.0}),
    "reversed channels": Setup({"RC1_REVERSED": 1.0, "RC3_REVERSED": 1.0}, throttle_us=1290),
    "neutral at 1400": Setup({"RC3_TRIM": 1400.0}, throttle_us=1610, trim=1400),
    "neutral at 1600": Setup({"RC3_TRIM": 1600.0}, throttle_us=1810, trim=1600),
    "backwards": Setup(throttle_us=1290),
    "backwards, neutral at 1600": Setup({"RC3_TRIM": 1600.0}, throttle_us=1390, trim=1600),
    "throttle sweep": Setup(manoeuvre=OVER_THROTTLE),
    "micros() wraps in the run": Setup(age_us=WRAP_US - 24_000_000),
    "RC_OVERRIDE_TIME 0.3": Setup({"RC_OVERRIDE_TIME": 0.3}),
    "RC_OVERRIDE_TIME 1.5": Setup({"RC_OVERRIDE_TIME": 1.5}),
    "RC_OVERRIDE_TIME -1": Setup({"RC_OVERRIDE_TIME": -1.0}),
    "GCS failsafe clears the overrides": Setup(
        {"FS_GCS_ENABLE": 1.0, "FS_GCS_TIMEOUT": 1.0, "FS_TIMEOUT": 0.1, "FS_ACTION": 0.0}
    ),
}


def driven(folder: Path, setup: Setup, *happenings: Happening) -> Outcome:
    world = World(folder / "vehicle", settings=setup.parameters, limit=60.0)
    for at, fault in happenings:
        world.happen(at, fault)
    rover = world.vehicle.rover
    assert rover is not None
    rover.now_us += setup.age_us
    rover.radio.transmitter[setup.throttle] = setup.trim
    world.run(4.0)
    for name, value in setup.later.items():
        world.vehicle.set(name, value)
    world.run(BOOT - 4.0)

    def program():  # as `virtual_run.played`
        world.enter("connecting")
        with Link.open("virtual:", folder / "connect.tlog", line=VirtualLine(world)) as link:
            for _ in start_streams(link):
                pass
            world.enter("uploading")
            settings = replace(SETTINGS, throttle_us=setup.throttle_us)
            yield from one_run(link, setup.manoeuvre, "sweep1", folder / "sweep1.tlog", settings)

    return _outcome(world, program(), asked=1, after=20.0, back=0.0)


@pytest.mark.parametrize("us", [1000, 1800])
@pytest.mark.parametrize("name", SETUPS)
def test_the_laptop_is_lost(tmp_path: Path, name: str, us: int) -> None:
    setup = SETUPS[name]
    happenings = (At("waiting", 1.5), stick(us, setup.throttle)), (At("waiting", 2.0), kill())
    outcome = driven(tmp_path, setup, *happenings)
    assert outcome.fired and held(outcome)
    assert metres_since(outcome, outcome.world.entered["waiting"] * 1e-6 + 2.0) <= FARTHEST
    rover = outcome.world.vehicle.rover
    assert rover is not None
    before = setup.parameters.get("RC_OVERRIDE_TIME", 3.0)
    assert rover.parameters["RC_OVERRIDE_TIME"] == pytest.approx(before, abs=1e-6)
    assert rover.parameters["SWP_LAPSE"] == rover.parameters["SWP_THR"] == 0.0


def test_a_stick_of_a_remapped_throttle_off_neutral_is_refused(tmp_path: Path) -> None:
    outcome = driven(tmp_path, SETUPS["other sticks, SWP_CHAN 7"], (At("connecting"), stick(1800, 1)))
    assert isinstance(outcome.error, UsageError) and "(RC2) is at 1800 us" in str(outcome.error)
    assert not any(row.armed for row in outcome.record.rows)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("SWP_LAPSE", math.nan),
        ("SWP_LAPSE", -1.0),
        ("SWP_LAPSE", 1e9),
        ("SWP_LAPSE", 0.01),
        ("SWP_THR", math.nan),
        ("SWP_THR", 1e9),
        ("SWP_BACK", 1e9),
        ("SWP_VER", 0.0),
        ("SWP_CHAN", 20.0),
    ],
)
def test_another_station_writes_what_makes_no_sense(tmp_path: Path, name: str, value: float) -> None:
    faults = stick(1800), set_by_other(name, value), kill()
    outcome = played(tmp_path, [(At("sweep", 1.0), fault) for fault in faults], limit=60.0, after=20.0)
    assert outcome.fired and held(outcome)
    assert metres_since(outcome, outcome.world.entered["sweep"] * 1e-6 + 1.0) <= FARTHEST


@pytest.mark.parametrize("queues", [True, False])
def test_a_stopped_program_sends_nothing_that_moves_when_it_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, queues: bool
) -> None:
    """SIGSTOP: unlike in sleep, every clock of the computer goes on. queues: what the rover sent waits."""

    def stop(world: World) -> None:
        world.laptop.wakes_us, world.laptop.queues = world.now_us + 20_000_000, queues

    monotonic = lambda self: MONOTONIC_0 + self.world.now  # noqa: E731
    with mock.patch.object(VirtualLine, "monotonic", monotonic):
        outcome = played(tmp_path, [(At("sweep", 1.0), Fault("SIGSTOP", stop))], limit=90.0, after=5.0)
    went_on = outcome.world.entered["sweep"] * 1e-6 + 21.0
    later = [sent for sent in outcome.record.sent if sent.t >= went_on]
    assert later and not any(sent.driving or sent.high for sent in later)
    assert outcome.fired and not outcome.armed and outcome.unasked == 0
