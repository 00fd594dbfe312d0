"""Every rule of the right to move: what it notices, and that nothing else does."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as m

from rover_sweep.vehicle.link.connection import VehicleClock
from rover_sweep.vehicle.run import right_to_move
from rover_sweep.vehicle.run.right_to_move import MovementLimits, RightToMove

LIMITS = MovementLimits(drives=True, ours={1: 1500, 3: 1500, 6: 1100}, manoeuvre=30.0, still=1.0, v_max=3.0)
WAITING, SWEEP = 2, 6
RC = 65536
GO = 4711


class Run:
    """A run that goes well: `go(seconds)` lets time pass with all messages, every 0.1 s."""

    def __init__(self, limits: MovementLimits = LIMITS) -> None:
        self.at, self.slept, self.wall_jump, self.boot = 100.0, 0.0, 0.0, 20.0
        self.silent = frozenset[str]()
        self.state, self.number, self.speed = 0, 7, 0.0
        self.mode, self.armed, self.health, self.rssi = 0, True, RC, 200
        self.pwm = dict.fromkeys(range(1, 17), 1500)
        self.whose, self.watch, self.lapse = GO, 1710, 1.0
        self.clock = VehicleClock()
        self.right = RightToMove(self, self.clock, limits)  # type: ignore[arg-type]
        self.go(0.5)
        self.right.watched(1710, 1.0, 3.0)
        self.right.thrown(before=7, go=GO)
        self.number, self.state, self.speed = 8, SWEEP, 2.0
        self.go(0.5)

    def monotonic(self) -> float:
        return self.at

    def since_boot(self) -> float:
        return self.at + self.slept

    def wall(self) -> float:
        return 1.7e9 + self.at + self.slept + self.wall_jump

    def go(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            self.at += 0.1
            self.boot += 0.1
            self.right.holds()
            for message in self.messages():
                if message.msgname not in self.silent and "all" not in self.silent:
                    self.clock.update(message)
                    self.right.message(message)
                    self.right.holds()

    def messages(self) -> list[Any]:
        ms = round(self.boot * 1000)
        base = m.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        channels = [self.pwm[n] for n in range(1, 17)]
        return [
            m.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0),
            m.MAVLink_heartbeat_message(10, 3, base, self.mode, 4, 3),
            SimpleNamespace(msgname="NAMED_VALUE_FLOAT", name="SWP_ST", value=float(self.state)),
            SimpleNamespace(msgname="NAMED_VALUE_FLOAT", name="SWP_RUN", value=float(self.number)),
            SimpleNamespace(msgname="NAMED_VALUE_FLOAT", name="SWP_GO", value=float(self.whose)),
            SimpleNamespace(msgname="NAMED_VALUE_FLOAT", name="SWP_THR", value=float(self.watch)),
            SimpleNamespace(msgname="PARAM_VALUE", param_id="RC_OVERRIDE_TIME", param_value=self.lapse),
            m.MAVLink_local_position_ned_message(ms, 0, 0, 0, self.speed, 0, 0),
            m.MAVLink_sys_status_message(RC, RC, self.health, 0, 0, -1, 0, 0, 0, 0, 0, 0, 0),
            m.MAVLink_rc_channels_message(ms, 16, *channels, 0, 0, self.rssi),
        ]

    @property
    def holds(self) -> bool:
        return self.right.holds()


def setting(seconds: float = 0.5, **values: Any) -> Callable[[Run], None]:
    def happen(run: Run) -> None:
        for name, value in values.items():
            setattr(run, name, value)
        run.go(seconds)

    return happen


def quiet(seconds: float, *kinds: str) -> Callable[[Run], None]:
    return setting(seconds, silent=frozenset(kinds))


def before_the_applet_reports(run: Run) -> None:
    """The switch is thrown, and nothing more is heard."""
    run.right._state, run.right._reported = 0, None
    quiet(1.0, "all")(run)


def asleep(run: Run) -> None:
    """The monotonic clock stands still meanwhile."""
    run.right._state, run.right._reported = 0, None
    run.slept += 40.0


def hole_unnoticed(run: Run) -> None:
    """No clock of the computer went on; the vehicle's did, and no report is missed by it."""
    run.state = run.right._state = 0
    run.boot += 2.0
    run.go(0.5)


def test_one_message_of_an_earlier_time_is_no_reboot() -> None:
    run = Run()
    run.clock.update(m.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0))
    run.go(0.5)
    assert run.holds and run.clock.boots == 0


def reboot(run: Run) -> None:
    run.boot = 2.0
    run.go(0.5)


def another_throttle(run: Run) -> None:
    """Another station's throttle shows, while our switch is in force."""
    run.right.sends({1: 1500, 3: 1710, 6: 1900})
    run.pwm |= {3: 1710, 6: 1900}
    run.go(0.5)
    run.pwm[3] = 1650
    run.go(0.3)


def jump_of_channels(run: Run) -> None:
    run.pwm |= {2: 1000, 5: 1100}
    run.go(0.3)


CASES: tuple[tuple[str, Callable[[Run], None], str], ...] = (
    ("same_boot", reboot, "the rover rebooted"),
    ("heard", before_the_applet_reports, "nothing was heard from the rover for"),
    ("heard", asleep, "nothing was heard from the rover for 40.0 s"),
    ("no_hole", hole_unnoticed, "s of the rover's messages are missing"),
    ("reported", quiet(1.2, "NAMED_VALUE_FLOAT"), "the applet has not reported its state for"),
    ("same_run", setting(number=9), "the applet started run 9 after run 8, without a request"),
    ("own_run", setting(whose=12), "belongs to another ground station (SWP_GO 12, this program drew 4711)"),
    ("watched", setting(watch=0), "the applet lost this program's overrides"),
    ("override_time", setting(lapse=30.0), "another ground station set RC_OVERRIDE_TIME to 30 s in the run"),
    ("slow_enough", setting(speed=3.1), "speed 3.10 m/s is above SWP_V_MAX 3"),
    ("speed_known", quiet(1.2, "LOCAL_POSITION_NED"), "speed is unknown"),
    ("in_time", setting(15.5, state=WAITING, speed=0.2), "15 s of throttle did not bring"),
    ("in_time", setting(37.0), "did not end its state 6 within 36 s"),
    ("transmitter_alive", setting(health=0), "the RC receiver is not healthy (SYS_STATUS)"),
    ("transmitter_alive", setting(rssi=0), "the radio's RSSI fell from 200 to 0"),
    ("transmitter_alive", jump_of_channels, "RC channels 2, 5 jumped at once"),
    ("undisputed", another_throttle, "RC channel 3 is at 1650 us, where this program sends 1710"),
    ("armed_in_manual", setting(armed=False), "the rover was disarmed"),
    ("armed_in_manual", setting(mode=4), "the rover left MANUAL (mode 4)"),
)


@pytest.mark.parametrize(("rule", "happen", "said"), CASES)
def test_the_right_is_lost_for_good(rule: str, happen: Callable[[Run], None], said: str) -> None:
    run = Run()
    assert run.holds, run.right.lost
    happen(run)
    assert not run.holds
    assert said in run.right.lost
    run.silent, run.armed, run.mode, run.speed, run.number = frozenset(), True, 0, 2.0, 8
    run.go(3.0)
    assert not run.holds and said in run.right.lost


@pytest.mark.parametrize(("rule", "happen", "said"), CASES)
def test_without_the_rule_it_holds(rule, happen, said, monkeypatch):
    rules = tuple(r for r in right_to_move.RULES if r.__name__ != rule)
    assert len(rules) == len(right_to_move.RULES) - 1
    monkeypatch.setattr(right_to_move, "RULES", rules)
    run = Run()
    happen(run)
    run.right.holds()
    assert run.right.lost == ""


def test_overrides_that_lapse_are_not_of_others() -> None:
    """All of ours go at once; what shows then is the radio."""
    run = Run()
    run.right.sends({1: 1500, 3: 1710, 6: 1900})
    run.pwm |= {3: 1710, 6: 1900}
    run.go(6.0)
    run.pwm |= {3: 1502, 6: 1105}
    run.go(1.0)
    assert run.holds and not run.right.contested


def test_every_rule_has_a_case() -> None:
    assert {rule.__name__ for rule in right_to_move.RULES} == {rule for rule, _, _ in CASES}


def test_a_wall_clock_that_is_set_only_waits() -> None:
    run = Run()
    run.wall_jump = 3600.0
    assert not run.holds and run.right.lost == ""
    run.go(0.6)
    assert run.holds


def test_a_sleep_that_only_the_wall_clock_shows_is_found_by_what_comes_next() -> None:
    run = Run()
    run.wall_jump, run.boot = 40.0, run.boot + 40.0
    assert not run.holds
    run.go(0.3)
    assert "are missing" in run.right.lost or "has not reported" in run.right.lost


def test_before_the_switch_is_thrown_short_holes_are_nothing() -> None:
    run = Run()
    other = RightToMove(run, run.clock, LIMITS)  # type: ignore[arg-type]
    run.right = other
    quiet(2.0, "all")(run)
    assert run.holds
    run.go(1.5)
    assert not run.holds
