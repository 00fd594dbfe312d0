"""What moved a rover that nobody asked to move, before the right to move was held in one place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from virtual_faults import asleep, hole, rc_lost, script_silent
from virtual_run import LIMITS, SETTINGS, Outcome, played
from virtual_world import At

HOLES = (3.2, 3.4, 3.6, 3.8, 4.2, 4.4, 4.5, 4.6, 4.8)
SLEEPS = (40.4, 40.5, 40.6, 40.7, 40.8)
MAY_BE_LATE = 1.0  # s
WAITING_ENDS = 15.0  # s


def nothing_moved_unasked(outcome: Outcome) -> None:
    assert outcome.fired, "the fault did not happen"
    assert outcome.unasked == 0, outcome.record.begun
    assert not outcome.again_high()
    assert outcome.misreported() == ""


def test_a_good_link_is_a_good_run(tmp_path: Path) -> None:
    outcome = played(tmp_path)
    assert outcome.error is None and outcome.finished is not None and outcome.finished.completed
    assert outcome.record.completed == (1,) and outcome.unasked == 0 and not outcome.armed
    assert 20.0 < outcome.record.metres() < 40.0
    assert outcome.sent_late() < 0.2 and outcome.record.driven_unheard() < 0.2
    nothing_moved_unasked(outcome)


def test_the_same_seed_is_the_same_world(tmp_path: Path) -> None:
    once, again = (played(tmp_path / name, [(At("sweep", 1.0), hole(2.0))], after=1.0) for name in "ab")
    assert once.record.rows == again.record.rows and once.said == again.said


@pytest.mark.parametrize("seconds", HOLES)
def test_no_second_sweep_after_a_hole(tmp_path: Path, seconds: float) -> None:
    nothing_moved_unasked(played(tmp_path, [(At("sweep", 1.0), hole(seconds))], after=5.0))


@pytest.mark.parametrize("seconds", SLEEPS)
def test_no_second_sweep_after_a_sleep(tmp_path: Path, seconds: float) -> None:
    outcome = played(tmp_path, [(At("sweep", 1.0), asleep(seconds, queues=False))], after=5.0)
    nothing_moved_unasked(outcome)


@pytest.mark.parametrize("phase", ["waiting", "straight", "sweep"])
def test_a_dead_applet_is_not_driven_on(tmp_path: Path, phase: str) -> None:
    outcome = played(tmp_path, [(At(phase, 0.5), script_silent())], limit=40.0, after=5.0)
    assert not outcome.overran
    assert outcome.sent_late(lambda sent: sent.state_heard) < MAY_BE_LATE
    assert not outcome.armed
    nothing_moved_unasked(outcome)


@pytest.mark.parametrize(("throttle_us", "v_max"), [(1900, 2.0), (1560, 5.0)])
def test_a_throttle_that_never_reaches_the_band_is_let_go(
    tmp_path: Path, throttle_us: int, v_max: float
) -> None:
    settings = replace(SETTINGS, throttle_us=throttle_us, extra={**LIMITS, "v_max": v_max})
    outcome = played(tmp_path, settings=settings, limit=60.0, after=5.0)
    assert not outcome.overran
    assert outcome.record.seconds() < WAITING_ENDS + 0.5
    assert not outcome.armed and outcome.misreported() == ""


def test_blind_is_not_driven(tmp_path: Path) -> None:
    outcome = played(tmp_path, [(At("sweep", 1.0), hole(direction="down"))], after=5.0)
    assert outcome.sent_late() < MAY_BE_LATE
    nothing_moved_unasked(outcome)


def test_without_a_transmitter_nothing_is_driven(tmp_path: Path) -> None:
    outcome = played(tmp_path, [(At("sweep", 1.0), rc_lost(1))], after=5.0)
    assert outcome.finished is not None and not outcome.finished.completed
    assert "RC lost" in outcome.said or "transmitter" in outcome.said
    assert outcome.record.seconds(since=outcome.world.entered["sweep"] * 1e-6) < 1.0 + 2.5
    nothing_moved_unasked(outcome)


def test_a_transmitter_is_missed_only_in_the_gaps_between_our_overrides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rover_sweep.vehicle.run.controls._GAP", 0.2)
    outcome = played(tmp_path, [(At("sweep", 1.0), rc_lost(1))], after=5.0)
    assert outcome.finished is not None and outcome.finished.completed


def test_a_receiver_that_goes_to_its_failsafe_values_is_noticed(tmp_path: Path) -> None:
    """The firmware looks at the throttle channel only, which is overridden."""
    outcome = played(tmp_path, [(At("sweep", 1.0), rc_lost(2))], after=5.0)
    assert outcome.finished is not None and not outcome.finished.completed
    assert "jumped at once" in outcome.said
    assert outcome.record.seconds(since=outcome.world.entered["sweep"] * 1e-6) < 1.0 + 1.0
    nothing_moved_unasked(outcome)
