"""The applet watches the overrides of a ground station that drives: HOLD before they lapse."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from applet_bench import HIGH, SOONEST_S, Bench, Drive, moving, mutant, throw_switch, without

TRIM, THROTTLE, LAPSE, HELD = 1500, 1710, 1.75, 1.5
HOLD, MANUAL = 4, 0
SHORT = {"still": 0, "trec": 60, "dwell": 0, "fade": 0, "straight": 0.5, "v_min": 1, "v_max": 4}
STRAIGHT, STOPPED = 3, 10


class Laptop:
    """Overrides throttle and steering, moving the latter by a us or two every 0.2 s."""

    def __init__(self, drive: Drive, drives: bool = True) -> None:
        self.drive, self.drives, self.step = drive, drives, 0
        self.bench.rc |= {1: TRIM, 3: THROTTLE if drives else TRIM}

    @property
    def bench(self) -> Bench:
        return self.drive.bench

    def declares(self, arms: bool = True) -> None:
        self.bench.is_armed = False
        self.bench.parameters |= {"SWP_THR": THROTTLE * self.drives, "SWP_LAPSE": LAPSE}
        self.go(0.4)
        self.bench.is_armed = arms

    def go(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.2)):
            self.step += 1
            if self.drives:
                self.bench.rc[1] = TRIM - 1 + self.step % 4
            self.drive.run(0.2)


def driven(source: str | None = None, drives: bool = True) -> Laptop:
    """In mid run."""
    drive = Drive(moving(2.0, **SHORT), source)
    laptop = Laptop(drive, drives)
    laptop.declares()
    drive.bench.parameters["SWP_GO"] = 7
    throw_switch(drive)
    drive.run_until(STRAIGHT)
    laptop.go(2.0)
    return laptop


def as_before(bench: Bench) -> bool:
    """RC_OVERRIDE_TIME is, nothing is declared, and no old override holds."""
    have = bench.parameters
    cleared = have["SWP_LAPSE"] == have["SWP_THR"] == 0 and set(bench.given_back) == {1, 3, 6}
    return have["RC_OVERRIDE_TIME"] == 3.0 and cleared


def test_while_it_lives_the_run_goes_on_with_a_short_override_time() -> None:
    bench = driven().bench
    assert bench.parameters["RC_OVERRIDE_TIME"] == LAPSE and bench.parameters["SWP_BACK"] == 3.0
    assert bench.current_mode == MANUAL and bench.state > 2 and not bench.given_back
    assert tuple(
        next(v for _, n, v in reversed(bench.floats) if n == name) for name in ("SWP_GO", "SWP_THR")
    ) == (7.0, THROTTLE)


def test_hold_comes_before_the_override_is_over() -> None:
    laptop = driven()
    bench = laptop.bench
    laptop.drive.run(HELD - 2 * SOONEST_S - 0.2)
    assert bench.current_mode == MANUAL
    laptop.drive.run(3 * SOONEST_S + 0.2)
    assert bench.current_mode == HOLD and bench.state == STOPPED and as_before(bench)
    assert "SWP: laptop lost (silent): HOLD" in bench.texts
    assert "SWP: run 1 stopped: laptop lost: silent" in bench.texts
    assert bench.overrides[-1][2] == 0, "the steering was not given back"


@pytest.mark.parametrize("us", [1000, 1505, 1709, 1900, 0])
def test_a_throttle_that_is_not_its_own_holds_at_once(us: int) -> None:
    laptop = driven()
    laptop.bench.rc[3] = us
    laptop.drive.run(SOONEST_S)
    assert laptop.bench.current_mode == HOLD and as_before(laptop.bench)
    assert f"SWP: run 1 stopped: laptop lost: thr {us} us" in laptop.bench.texts


def test_a_throttle_on_another_channel_holds_at_once() -> None:
    laptop = driven()
    laptop.bench.parameters["RCMAP_THROTTLE"] = 2
    laptop.drive.run(SOONEST_S)
    assert laptop.bench.current_mode == HOLD
    assert "SWP: run 1 stopped: laptop lost: RCMAP" in laptop.bench.texts


def test_its_throttle_at_trim_is_its_own() -> None:
    laptop = driven()
    laptop.bench.rc[3] = TRIM
    laptop.go(1.0)
    assert laptop.bench.current_mode == MANUAL


def test_a_vehicle_that_refuses_hold_is_disarmed() -> None:
    laptop = driven()
    laptop.bench.changes_mode = False
    laptop.drive.run(2.0)
    assert not laptop.bench.is_armed and "SWP: laptop lost (silent): disarmed" in laptop.bench.texts


def test_armed_without_a_run_is_watched_too() -> None:
    laptop = Laptop(Drive(moving(0.0)))
    laptop.declares()
    laptop.drive.run(2.0)
    assert laptop.bench.current_mode == HOLD and as_before(laptop.bench)


def test_disarmed_it_is_only_forgotten() -> None:
    laptop = Laptop(Drive(moving(0.0)))
    laptop.declares(arms=False)
    laptop.bench.rc[3] = 1000  # the stick, where an override was lost
    laptop.go(0.4)
    assert laptop.bench.parameters["SWP_LAPSE"] == LAPSE
    laptop.drive.run(2.0)
    assert laptop.bench.current_mode == MANUAL and as_before(laptop.bench)
    assert not any("laptop" in text for text in laptop.bench.texts)


def test_one_that_leaves_after_disarming_leaves_everything_as_before() -> None:
    laptop = driven()
    laptop.bench.is_armed = False
    laptop.go(0.2)
    laptop.bench.parameters["SWP_LAPSE"] = 0.0
    laptop.drive.run(SOONEST_S)
    assert as_before(laptop.bench) and laptop.bench.current_mode == MANUAL


def test_one_that_leaves_an_armed_rover_is_lost() -> None:
    """Or somebody else wrote SWP_LAPSE."""
    laptop = driven()
    laptop.bench.parameters["SWP_LAPSE"] = 0.0
    laptop.drive.run(SOONEST_S)
    assert as_before(laptop.bench) and laptop.bench.current_mode == HOLD
    assert "SWP: run 1 stopped: laptop lost: it left" in laptop.bench.texts


def test_who_is_watched_is_not_changed_by_a_parameter() -> None:
    laptop = driven()
    laptop.bench.parameters["SWP_THR"] = 0.0
    laptop.go(0.4)
    assert laptop.bench.current_mode == MANUAL
    laptop.drive.run(2.0)
    assert laptop.bench.current_mode == HOLD


def test_a_run_that_the_pilot_drives_is_never_held() -> None:
    """Declared for the switch alone: the override time comes back once the ground station is not heard."""
    laptop = driven(drives=False)
    bench = laptop.bench
    bench.heard_ms = bench.now // 1000
    bench.rc[3] = 1800
    laptop.drive.run(3.0)
    assert bench.current_mode == MANUAL and as_before(bench)


def test_nor_one_on_the_switch_without_a_laptop() -> None:
    drive = Drive(moving(2.0, **SHORT))
    throw_switch(drive)
    drive.run_until(STRAIGHT)
    drive.bench.heard_ms, drive.bench.rc[3] = drive.bench.now // 1000, 1800
    drive.run(5.0)
    assert drive.bench.current_mode == MANUAL and drive.bench.state > 2


@pytest.mark.parametrize("seconds", [30.0, -1.0])
def test_an_override_time_of_somebody_else_ends_the_run_and_counts_afterwards(seconds: float) -> None:
    laptop = driven()
    have = laptop.bench.parameters
    have["RC_OVERRIDE_TIME"] = seconds
    laptop.go(0.2)
    assert have["RC_OVERRIDE_TIME"] == LAPSE and have["SWP_BACK"] == seconds
    assert f"SWP: run 1 stopped: RC_OVERRIDE_TIME set to {seconds:g}" in laptop.bench.texts
    laptop.bench.is_armed, have["SWP_LAPSE"] = False, 0.0
    laptop.drive.run(SOONEST_S)
    assert have["RC_OVERRIDE_TIME"] == seconds


def test_a_script_that_starts_again_still_watches() -> None:
    bench = driven().bench
    bench.switch, bench.rc[6] = HIGH, 1900
    again = Drive(bench)
    again.run(2.0)
    assert bench.current_mode == HOLD and as_before(bench)


def test_after_a_reboot_the_stored_override_time_stays_and_nobody_is_watched() -> None:
    bench = driven().bench
    bench.parameters["RC_OVERRIDE_TIME"] = 3.0  # as in storage
    bench.is_armed = False
    again = Drive(bench)
    assert as_before(bench)
    bench.is_armed = True
    bench.rc[3] = 1650
    again.run(3.0)
    assert bench.current_mode == MANUAL


def test_who_arms_after_a_silence_is_held() -> None:
    """The order to arm came through, or late, and what the ground station does since is unknown."""
    laptop = Laptop(Drive(moving(0.0)))
    laptop.declares(arms=False)
    laptop.drive.run(4.0)
    assert as_before(laptop.bench)
    laptop.bench.is_armed = True
    laptop.drive.run(SOONEST_S)
    assert laptop.bench.current_mode == HOLD
    laptop.bench.current_mode = MANUAL
    laptop.drive.run(3.0)
    assert laptop.bench.current_mode == MANUAL, "only once"


def test_who_arms_a_minute_after_a_silence_is_not() -> None:
    laptop = Laptop(Drive(moving(0.0)))
    laptop.declares(arms=False)
    laptop.drive.run(64.0)
    laptop.bench.is_armed = True
    laptop.drive.run(1.0)
    assert laptop.bench.current_mode == MANUAL


def test_an_armed_rover_is_not_taken_over() -> None:
    """SWP_LAPSE and SWP_THR out of a file of parameters, while the pilot drives."""
    laptop = Laptop(Drive(moving(2.0)))
    laptop.bench.parameters |= {"SWP_THR": THROTTLE, "SWP_LAPSE": LAPSE}
    laptop.bench.rc[3] = 1650
    laptop.drive.run(3.0)
    assert laptop.bench.current_mode == MANUAL and laptop.bench.parameters["RC_OVERRIDE_TIME"] == 3.0


def test_what_a_slow_link_delivers_after_the_loss_is_given_back_at_once() -> None:
    laptop = driven()
    laptop.drive.run(2.5)
    bench = laptop.bench
    assert bench.current_mode == HOLD
    bench.current_mode, bench.rc[3], bench.given_back = MANUAL, TRIM, []
    laptop.drive.run(5.0)
    assert not bench.given_back
    bench.rc[3] = THROTTLE
    laptop.drive.run(SOONEST_S)
    assert set(bench.given_back) == {1, 3, 6}
    bench.given_back = []
    laptop.drive.run(1.0)
    assert not bench.given_back, "a lost radio would not be missed"


def test_an_override_keeps_no_throw_of_the_pilots_own_switch() -> None:
    """His switch is high beneath the override, which ends."""
    laptop = Laptop(Drive(moving(2.0, **SHORT)), drives=False)
    laptop.bench.switch = 0
    laptop.declares()
    laptop.bench.parameters["SWP_GO"] = 7  # written, and its program killed
    laptop.go(0.2)
    laptop.bench.heard_ms = laptop.bench.now // 1000
    laptop.drive.run(2.0)
    laptop.bench.switch = HIGH
    laptop.drive.run(0.5)
    assert laptop.bench.parameters["SWP_RUN"] == 0 and "needs a new SWP_GO" in laptop.bench.texts[-1]


@pytest.mark.parametrize("name", ["SWP_BACK", "SWP_VER"])
def test_what_belongs_to_no_run_refuses_none(name: str) -> None:
    drive = Drive(moving(2.0, **SHORT))
    drive.bench.parameters[name] = 1e6
    throw_switch(drive)
    drive.run_until(STRAIGHT)


def test_what_was_before_is_kept_from_others() -> None:
    laptop = driven()
    laptop.bench.parameters |= {"SWP_BACK": 1e9, "SWP_THR": 0.0}
    laptop.go(0.4)
    laptop.drive.run(2.5)
    assert laptop.bench.current_mode == HOLD and as_before(laptop.bench)


def test_the_time_after_which_a_radio_is_lost_is_short_meanwhile() -> None:
    laptop = Laptop(Drive(moving(0.0)))
    have = laptop.bench.parameters
    have["RC_FS_TIMEOUT"] = 1.0  # since 4.7
    laptop.declares()
    assert have["RC_FS_TIMEOUT"] == 0.5
    have["SWP_LAPSE"] = 0.0
    laptop.drive.run(SOONEST_S)
    assert have["RC_FS_TIMEOUT"] == 1.0


def test_after_a_lost_laptop_a_run_needs_a_new_number() -> None:
    laptop = driven()
    laptop.drive.run(2.0)
    bench = laptop.bench
    bench.current_mode = MANUAL
    throw_switch(laptop.drive)
    laptop.drive.run(0.5)
    assert bench.parameters["SWP_RUN"] == 1 and "needs a new SWP_GO" in bench.texts[-1]


@pytest.mark.parametrize(
    ("source", "holds"),
    [
        (without("vehicle:set_mode(laptop.HOLD)"), False),
        (
            mutant(
                (
                    "local reason, drives = laptop.lost(seen), laptop.thr ~= 0",
                    "local reason, drives = nil, false",
                )
            ),
            False,
        ),
        (mutant(("seconds_since(laptop.moved) <= laptop.lapse - laptop.MARGIN_S", "true")), False),
        (mutant(("laptop.seen, laptop.moved = steering, micros()", "laptop.moved = micros()")), False),
    ],
    ids=["no HOLD", "not looked", "no time", "never still"],
)
def test_without_its_line_nothing_is_held(source: str, holds: bool) -> None:
    laptop = driven(source)
    laptop.drive.run(3.0)
    assert laptop.drive.host.error is None
    assert (laptop.bench.current_mode == HOLD) is holds


def test_without_its_line_another_throttle_drives() -> None:
    laptop = driven(mutant(('return string.format("thr %d us", throttle or 0)', "return nil")))
    laptop.bench.rc[3] = 1900
    laptop.go(1.0)
    assert laptop.bench.current_mode == MANUAL


@pytest.mark.parametrize(
    ("line", "kept"),
    [
        ("channel:set_override(0)", lambda bench: not bench.given_back),
        ("laptop.time:set(laptop.before)", lambda b: b.parameters["RC_OVERRIDE_TIME"] == LAPSE),
        ("parameter.THR:set_and_save(0)", lambda bench: bench.parameters["SWP_THR"] == THROTTLE),
    ],
)
def test_without_its_line_something_is_left(line: str, kept: Callable[[Bench], bool]) -> None:
    laptop = driven(without(line))
    laptop.drive.run(2.0)
    assert laptop.bench.current_mode == HOLD and kept(laptop.bench) and not as_before(laptop.bench)
