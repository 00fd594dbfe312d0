"""One SWP_GO is one run; each rule of it with the applet in which it is taken out."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from applet_bench import HIGH, LOW, Bench, Drive, moving, mutant, throw_switch, thrown

REFUSED = "SWP: refused: after run 1, needs a new SWP_GO"
STRAIGHT, STOPPED, IDLE = 3, 10, 0
SHORT = {"still": 0, "trec": 2, "dwell": 0, "fade": 0, "straight": 0.5, "v_min": 1, "v_max": 4}


def driven(source: str | None = None, **settings: float) -> Drive:
    """Run 1 steers; SWP_GO is as it was when the applet started."""
    drive = thrown(moving(2.0, **SHORT | settings), source)
    drive.run_until(STRAIGHT)
    return drive


def asked_for(source: str | None = None) -> Drive:
    """The same with a new SWP_GO written by the ground."""
    drive = Drive(moving(2.0, **SHORT), source)
    drive.bench.parameters["SWP_GO"] = 7
    throw_switch(drive)
    drive.run_until(STRAIGHT)
    return drive


def lose_ground(bench: Bench) -> None:
    bench.heard_ms = bench.now // 1000


def hear_ground(bench: Bench) -> None:
    bench.heard_ms = None


def begins_again(drive: Drive) -> bool:
    """The switch goes low and high; whether another run begins."""
    before = drive.bench.parameters["SWP_RUN"]
    throw_switch(drive)
    drive.run(0.3)
    return drive.bench.parameters["SWP_RUN"] != before


def after_lost_ground(source: str | None = None) -> Drive:
    drive = driven(source, gcs=1, trec=20)
    lose_ground(drive.bench)
    drive.run_until(STOPPED)
    assert "SWP: run 1 stopped: GCS lost" in drive.bench.texts
    return drive


def after_pause(source: str | None = None) -> Drive:
    drive = driven(source)
    drive.pause(0.5)
    assert drive.bench.state == STOPPED
    return drive


def after_lapse(source: str | None = None) -> Drive:
    """The override of the switch ran out in a silence of 3.2 s; SWP_GCS is 0."""
    drive = driven(source, trec=20)
    lose_ground(drive.bench)
    drive.run(3.2)
    drive.bench.switch = LOW
    drive.run(0.1)
    assert "SWP: run 1 stopped: switch low" in drive.bench.texts
    return drive


def after_the_end(source: str | None = None) -> Drive:
    drive = asked_for(source)
    drive.run_until(IDLE)
    assert "SWP: run 1 done" in drive.bench.texts
    return drive


def after_stop(source: str | None = None) -> Drive:
    drive = asked_for(source)
    drive.bench.switch = LOW
    drive.run_until(IDLE)
    return drive


ENDS = (after_lost_ground, after_pause, after_lapse, after_the_end, after_stop)
End = Callable[..., Drive]


@pytest.mark.parametrize("end", ENDS)
def test_no_other_run_begins(end: End) -> None:
    drive = end()
    hear_ground(drive.bench)
    assert not begins_again(drive)
    assert drive.bench.texts[-1] == REFUSED


@pytest.mark.parametrize("end", ENDS)
def test_a_new_number_begins_one(end: End) -> None:
    drive = end()
    hear_ground(drive.bench)
    drive.bench.parameters["SWP_GO"] = 8
    assert begins_again(drive)


@pytest.mark.parametrize(
    ("end", "old", "new"),
    [
        (after_lost_ground, 'reason == "GCS lost" or reason and', "reason and"),
        (after_pause, 'or reason and string.find(reason, "^script paused")', ""),
        (after_lapse, "if ended.asked or unattended or lapsed then", "if ended.asked or unattended then"),
        (after_the_end, "if ended.asked or unattended or lapsed then", "if unattended or lapsed then"),
        (after_stop, "if ended.asked or unattended or lapsed then", "if unattended or lapsed then"),
        (after_lost_ground, " or go.refuse(values)", ""),
    ],
)
def test_another_begins_without_the_rule(end: End, old: str, new: str) -> None:
    drive = end(mutant((old, new)))
    hear_ground(drive.bench)
    assert begins_again(drive)


def test_the_pilot_alone_throws_as_often_as_he_likes() -> None:
    drive = driven()
    drive.run_until(IDLE)
    assert begins_again(drive)


def test_a_stop_by_the_pilot_asks_for_no_number() -> None:
    drive = driven()
    drive.bench.switch = LOW
    drive.run_until(IDLE)
    assert begins_again(drive)


def throw_alone(drive: Drive, age_s: float) -> None:
    """High and low while the ground station has been silent for `age_s` s."""
    drive.bench.heard_ms = drive.bench.now // 1000 - round(1000 * age_s)
    drive.bench.switch = HIGH
    drive.run(0.2)
    drive.bench.switch = LOW
    drive.run(0.2)
    hear_ground(drive.bench)


def test_the_pilots_own_switch_unlocks() -> None:
    drive = after_lost_ground()
    throw_alone(drive, 5.0)
    assert begins_again(drive)


def test_a_switch_that_an_override_may_hold_does_not() -> None:
    drive = after_lost_ground()
    throw_alone(drive, 3.3)
    assert not begins_again(drive)


def test_it_does_without_the_rule() -> None:
    drive = after_lost_ground(mutant(("seen.gcs_age_ms > lapse + go.MARGIN_MS", "true")))
    throw_alone(drive, 3.3)
    assert begins_again(drive)


def test_a_switch_that_only_falls_back_to_low_does_not() -> None:
    drive = after_lost_ground()
    drive.bench.heard_ms = drive.bench.now // 1000 - 5000
    drive.bench.switch = LOW
    drive.run(2.0)
    hear_ground(drive.bench)
    assert not begins_again(drive)


def test_an_override_that_never_lapses_is_never_the_pilots() -> None:
    drive = after_lost_ground()
    drive.bench.parameters["RC_OVERRIDE_TIME"] = -1
    throw_alone(drive, 60.0)
    assert not begins_again(drive)


def test_the_last_whole_run_is_reported() -> None:
    drive = driven()
    drive.run_until(IDLE)
    drive.run(1.5)
    assert ("SWP_DONE", 1.0) in [(name, value) for _, name, value in drive.bench.floats]


def test_a_stopped_run_is_not_reported_as_whole() -> None:
    drive = driven()
    drive.bench.switch = LOW
    drive.run(3.0)
    assert "SWP_DONE" not in {name for _, name, _ in drive.bench.floats}
