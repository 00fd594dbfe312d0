"""The laptop is lost while it drives, and the stick beneath its override is off neutral: the rover stops.

The applet alone does it, since from the laptop nothing comes any more.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import pytest
from test_second_station import SAME, once, parameter, station
from virtual_faults import asleep, each_step, hole, kill
from virtual_run import Outcome, applet_without, played, session_played
from virtual_world import At, Fault, Phase, World

from rover_sweep.errors import UsageError
from rover_sweep.vehicle.identity import AppletUnready
from rover_sweep.vehicle.link.link import Link
from rover_sweep.vehicle.run.controls import pump
from sitl.autopilot.rover import HOLD, MANUAL

THROTTLE, STEERING, MODE = 2, 0, 7  # RC channels, 0-based
STICKS = (1000, 1200, 1800, 1900)  # us
FARTHEST = 12.0  # m
UNNOTICED = 0.0  # s, so that the laptop does not end the run before
MODE_MANUAL, MODE_HOLD = 1800, 1000  # us: MODE6 and MODE1 of the embedded rover


def stick(us: int, channel: int = THROTTLE) -> Fault:
    """The pilot moves a stick, or has moved it."""

    def begin(world: World) -> None:
        assert world.vehicle.rover is not None
        world.vehicle.rover.radio.transmitter[channel] = us

    return Fault(f"RC{channel + 1} at {us} us", begin)


LOSSES: dict[str, Callable[[], Fault]] = {
    "kill -9": kill,
    "hole for good": hole,
    "uplink gone for good": lambda: hole(direction="up"),
    "sleep": lambda: asleep(40.0, queues=False),
}


def metres_since(outcome: Outcome, t: float) -> float:
    """Way along the track from that time on [m]."""
    rows = [row for row in outcome.record.rows if row.t >= t]
    return sum(((b.x - a.x) ** 2 + (b.y - a.y) ** 2) ** 0.5 for a, b in zip(rows, rows[1:], strict=False))


def held(outcome: Outcome) -> bool:
    rover = outcome.world.vehicle.rover
    assert rover is not None
    return not rover.armed or rover.mode == HOLD


def lost(
    folder: Path,
    phase: Phase,
    loss: Callable[[], Fault],
    *others: Fault,
    seconds: float = 1.0,
    before: float = 0.5,
) -> tuple[Outcome, float]:
    """A run in which `others` happen so long before the loss [s]; and the way after the loss [m]."""
    happenings = [*((At(phase, seconds - before), fault) for fault in others), (At(phase, seconds), loss())]
    outcome = played(folder, happenings, limit=60.0, after=30.0)
    assert outcome.fired
    return outcome, metres_since(outcome, outcome.world.entered[phase] * 1e-6 + seconds)


@pytest.mark.parametrize("us", STICKS)
@pytest.mark.parametrize("loss", LOSSES)
def test_a_stick_moved_in_mid_run_does_not_drive(tmp_path: Path, loss: str, us: int) -> None:
    outcome, metres = lost(tmp_path, "sweep", LOSSES[loss], stick(us))
    assert metres <= FARTHEST and held(outcome)
    texts = [text for _, text in outcome.record.texts]
    assert any(text == "SWP: laptop lost (silent): HOLD" for text in texts)


@pytest.mark.parametrize("phase", ["arming", "standing", "waiting", "straight", "after", "standing after"])
def test_nor_in_any_other_phase(tmp_path: Path, phase: Phase) -> None:
    outcome, metres = lost(tmp_path, phase, kill, stick(1800), seconds=0.7)
    assert metres <= FARTHEST and held(outcome)


def test_nor_while_it_lets_go(tmp_path: Path) -> None:
    outcome = played(
        tmp_path, [(At("standing after"), stick(1800)), (At("letting go"), kill())], limit=60.0, after=30.0
    )
    assert outcome.fired and held(outcome)
    assert metres_since(outcome, outcome.world.entered["letting go"] * 1e-6) <= FARTHEST


@pytest.mark.parametrize("us", STICKS)
def test_a_stick_off_neutral_before_the_run_is_refused(tmp_path: Path, us: int) -> None:
    outcome = played(tmp_path, [(At("connecting"), stick(us))], limit=60.0, after=2.0)
    assert isinstance(outcome.error, UsageError) and f"(RC3) is at {us} us" in str(outcome.error)
    assert not any(row.armed for row in outcome.record.rows) and not outcome.record.sent


def test_a_station_of_the_same_id_does_not_stand_in_for_the_laptop(tmp_path: Path) -> None:
    """Its heartbeats keep the firmware's own watch over the ground station content."""
    other = station("heartbeats", once(), SAME)
    outcome, metres = lost(tmp_path, "sweep", kill, other, stick(1800))
    assert metres <= FARTHEST and held(outcome)


@pytest.mark.parametrize("seconds", [30.0, -1.0])
@pytest.mark.parametrize("loss", LOSSES)
def test_nor_does_a_longer_override_time(tmp_path: Path, loss: str, seconds: float) -> None:
    other = station("sets", once(parameter("RC_OVERRIDE_TIME", seconds)))
    outcome, metres = lost(tmp_path, "sweep", LOSSES[loss], other, before=UNNOTICED)
    assert metres <= FARTHEST and held(outcome)


@pytest.mark.parametrize("seconds", [30.0, -1.0])
def test_an_override_time_set_in_the_run_ends_it_and_is_told_as_read(tmp_path: Path, seconds: float) -> None:
    other = station("sets", once(parameter("RC_OVERRIDE_TIME", seconds)))
    outcome = played(tmp_path, [(At("sweep", 1.0), other)], limit=60.0, after=2.0)
    assert outcome.finished is not None and not outcome.finished.completed and not outcome.armed
    assert f"RC_OVERRIDE_TIME set to {seconds:g}" in outcome.said
    assert f"RC_OVERRIDE_TIME is {seconds:g} s; it was 3 s before the run" in outcome.said
    rover = outcome.world.vehicle.rover
    assert rover is not None and rover.parameters["RC_OVERRIDE_TIME"] == seconds


@pytest.mark.parametrize("seconds", [3.0, -1.0])
def test_the_pilot_takes_it_back_with_the_mode_switch_and_no_old_override(
    tmp_path: Path, seconds: float
) -> None:
    """Whatever RC_OVERRIDE_TIME is then: the last throttle of the laptop is gone for good."""
    sets = station("sets", once(parameter("RC_OVERRIDE_TIME", seconds)))
    outcome, _ = lost(tmp_path, "sweep", kill, sets, before=UNNOTICED)
    world, rover = outcome.world, outcome.world.vehicle.rover
    assert rover is not None and rover.armed and rover.mode == HOLD
    for us in (MODE_HOLD, MODE_MANUAL):
        stick(us, MODE).begin(world)
        world.run(1.0)
    assert rover.mode == MANUAL and rover.armed
    at = world.now
    world.run(10.0)
    assert metres_since(outcome, at) < 0.5
    stick(1600).begin(world)
    world.run(3.0)
    assert rover.plant.state.vx > 0.3, "the rover is not the pilot's"


@pytest.mark.parametrize("seed", [pytest.param(n, marks=pytest.mark.slow if n else ()) for n in range(10)])
def test_killed_at_any_instant_nothing_is_left(tmp_path: Path, seed: int) -> None:
    """kill -9 at ten instants, at random from the first message to the end: nothing moves 4 s later, no
    parameter of the run stays, and no recording is shorter than it was."""
    draw = random.Random(seed)
    for number in range(10):
        at = draw.uniform(0.0, 22.0)
        outcome = played(
            tmp_path / str(number), [(At("connecting", at), kill())], limit=60.0, after=12.0, back=0.0
        )
        outcome.world.run(5.0)  # a rover that is disarmed is not waited for
        rover = outcome.world.vehicle.rover
        assert rover is not None and outcome.killed, f"at {at:.2f} s"
        late = [row for row in outcome.record.rows if row.t > outcome.ended + 4.0]
        assert all(abs(row.speed) < 0.5 for row in late) and held(outcome), f"at {at:.2f} s"
        have = rover.parameters
        left = (have["RC_OVERRIDE_TIME"], have["SWP_LAPSE"], have["SWP_THR"])
        assert left == (3.0, 0.0, 0.0), f"at {at:.2f} s"


def test_a_run_of_another_program_is_not_followed(tmp_path: Path) -> None:
    """Both allowed a run at the same instant, and the other's number counts."""

    def counts(world: World) -> None:
        rover = world.vehicle.rover
        assert rover is not None
        if rover.parameters["SWP_GO"] not in (0.0, 12.0):
            rover.parameters.set("SWP_GO", 12.0)

    with mock.patch("rover_sweep.vehicle.run.one_run.write_go", _unconfirmed):
        outcome = played(tmp_path, [(At("arming"), each_step("other", counts, 30.0))], limit=60.0, after=5.0)
    assert outcome.finished is not None and not outcome.finished.completed and not outcome.armed
    assert "belongs to another ground station (SWP_GO 12, this program drew 4711)" in outcome.said


def _unconfirmed(link: Link) -> int:
    """The other writes right after the value was read back."""
    link.to_vehicle("PARAM_SET", param_id=b"SWP_GO", param_value=4711.0, param_type=9)
    pump(link, 0.1)
    return 4711


def test_a_second_program_does_not_begin(tmp_path: Path) -> None:
    """It sees that the first overrides."""

    def overridden(world: World) -> None:
        rover = world.vehicle.rover
        assert rover is not None
        rover.parameters.set("SWP_LAPSE", 1.5)

    outcome = played(tmp_path, [(At("arming"), each_step("first", overridden, 30.0))], limit=60.0, after=1.0)
    assert "another ground station overrides this rover" in str(outcome.error)
    assert not any(row.armed for row in outcome.record.rows)


@pytest.mark.parametrize("changed", ['local VERSION = "1.5"', "local PERIOD_MS = 10"])
def test_another_applet_is_not_driven(tmp_path: Path, monkeypatch, changed: str) -> None:
    """One of another version, and one of this version that somebody changed."""
    other = changed.replace("1.5", "1.4").replace("10", "11")
    applet_without(monkeypatch, tmp_path, (changed, other))
    outcome = session_played(tmp_path, after=1.0)
    assert isinstance(outcome.error, AppletUnready)
    words = "runs applet 1.4, this program needs 1.5" if "1.4" in other else "another checksum"
    assert words in str(outcome.error)
    assert not any(row.armed for row in outcome.record.rows) and not outcome.record.sent


# ---- Without the rule.


UNWATCHED = ("local reason, drives = laptop.lost(seen), laptop.thr ~= 0", "local reason, drives = nil, false")
UNCAPPED = ("if math.abs(now - laptop.lapse) > 0.001 then", "if false then")


def test_without_the_watch_the_stick_drives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    applet_without(monkeypatch, tmp_path, UNWATCHED)
    outcome, metres = lost(tmp_path, "sweep", kill, stick(1800))
    assert metres > 5 * FARTHEST and not held(outcome)


def test_without_the_watch_a_longer_override_time_drives_on(tmp_path, monkeypatch):
    applet_without(monkeypatch, tmp_path, UNWATCHED, UNCAPPED)
    other = station("sets", once(parameter("RC_OVERRIDE_TIME", 30.0)))
    _, metres = lost(tmp_path, "sweep", kill, other, before=UNNOTICED)
    assert metres > 2 * FARTHEST


def test_without_the_last_look_at_the_sticks_one_off_neutral_is_driven(tmp_path, monkeypatch):
    monkeypatch.setattr("rover_sweep.vehicle.run.takeover.Takeover.check_sticks", lambda self: None)
    outcome = played(tmp_path, [(At("connecting"), stick(1800))], limit=60.0, after=2.0)
    assert any(row.armed for row in outcome.record.rows)
