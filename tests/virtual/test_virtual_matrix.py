"""Every fault in every phase of a run: what is promised holds; and what breaks without the rules."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from virtual_faults import hole, rc_lost, script_silent
from virtual_matrix import CASES, MOMENTS
from virtual_promises import broken, noticed, problems_of, without
from virtual_run import LIMITS, SETTINGS, played
from virtual_world import At

RULES = "rover_sweep.vehicle.run.right_to_move.RULES"


SLOW = ("uploading + 0.3 s", "sweep + 1 s")


@pytest.mark.parametrize(
    "moment", [pytest.param(m, marks=pytest.mark.slow if m in SLOW else ()) for m in MOMENTS]
)
def test_what_is_promised_holds(moment: str, tmp_path: Path) -> None:
    """All faults that begin at that moment."""
    found = problems_of(MOMENTS[moment], tmp_path)
    assert found == {case.name: [] for case in MOMENTS[moment]}


def test_no_case_is_left_out() -> None:
    assert sorted(c.name for cases in MOMENTS.values() for c in cases) == sorted(
        c.name for c in CASES.values()
    )


@pytest.mark.parametrize(
    ("rules", "case"),
    [
        (("reported",), "script silent @ sweep + 0.3 s"),
        (("reported",), "script silent @ waiting + 0.3 s"),
        (("heard", "reported", "no_hole"), "hole down inf s @ sweep + 0.3 s"),
        (("heard", "reported", "no_hole", "speed_known"), "hole down 4 s @ waiting + 0.3 s"),
    ],
)
def test_what_is_promised_breaks_without_the_rule(rules: tuple[str, ...], case: str, tmp_path: Path) -> None:
    assert noticed(RULES, without(*rules), CASES[case], tmp_path)


@pytest.mark.parametrize(
    ("place", "instead", "case"),
    [
        ("rover_sweep.vehicle.run.controls.MAY_BE_ARMED", "", "hole both inf s @ sweep + 0.3 s"),
        ("rover_sweep.vehicle.run.controls.HIGH", 1100, "hole both 0.6 s @ waiting + 0.3 s"),
    ],
)
def test_it_breaks_without_the_mechanism(place: str, instead: object, case: str, tmp_path: Path) -> None:
    assert noticed(place, instead, CASES[case], tmp_path)


# ---- What moved a rover that nobody asked to move, before the right to move was held in one place.

WAITING_ENDS = 15.0  # s


def test_a_good_link_is_a_good_run(tmp_path: Path) -> None:
    outcome = played(tmp_path)
    assert outcome.error is None and outcome.finished is not None and outcome.finished.completed
    assert outcome.record.completed == (1,) and outcome.unasked == 0 and not outcome.armed
    assert 20.0 < outcome.record.metres < 40.0
    assert outcome.sent_late() < 0.2 and outcome.record.driven_unheard() < 0.2
    assert outcome.fired and broken(outcome) == []


def test_the_same_seed_is_the_same_world(tmp_path: Path) -> None:
    once, again = (played(tmp_path / name, [(At("sweep", 1.0), hole(2.0))], after=1.0) for name in "ab")
    assert once.record.rows == again.record.rows and once.said == again.said


def test_a_dead_applet_is_not_driven_on(tmp_path: Path) -> None:
    outcome = played(tmp_path, [(At("waiting", 0.5), script_silent())], limit=40.0, after=5.0)
    assert not outcome.armed and outcome.fired and broken(outcome) == []


@pytest.mark.parametrize(("throttle_us", "v_max"), [(1900, 2.0), (1560, 5.0)])
def test_a_throttle_that_never_reaches_the_band_is_let_go(tmp_path, throttle_us, v_max):
    settings = replace(SETTINGS, throttle_us=throttle_us, extra={**LIMITS, "v_max": v_max})
    outcome = played(tmp_path, settings=settings, limit=60.0, after=5.0)
    assert outcome.record.seconds() < WAITING_ENDS + 0.5
    assert not outcome.armed and broken(outcome) == []


def test_without_a_transmitter_nothing_is_driven(tmp_path: Path) -> None:
    outcome = played(tmp_path, [(At("sweep", 1.0), rc_lost(1))], after=5.0)
    assert outcome.finished is not None and not outcome.finished.completed
    assert "RC lost" in outcome.said or "transmitter" in outcome.said
    assert outcome.record.seconds(since=outcome.world.entered["sweep"] * 1e-6) < 1.0 + 2.5
    assert outcome.fired and broken(outcome) == []


def test_a_transmitter_is_missed_only_in_the_gaps_between_our_overrides(tmp_path, monkeypatch):
    monkeypatch.setattr("rover_sweep.vehicle.run.controls._GAP", 0.2)
    outcome = played(tmp_path, [(At("sweep", 1.0), rc_lost(1))], after=5.0)
    assert outcome.finished is not None and outcome.finished.completed


def test_a_receiver_that_goes_to_its_failsafe_values_is_noticed(tmp_path: Path) -> None:
    """The firmware looks at the throttle channel only, which is overridden."""
    outcome = played(tmp_path, [(At("sweep", 1.0), rc_lost(2))], after=5.0)
    assert outcome.finished is not None and not outcome.finished.completed
    assert "jumped at once" in outcome.said
    assert outcome.record.seconds(since=outcome.world.entered["sweep"] * 1e-6) < 1.0 + 1.0
    assert outcome.fired and broken(outcome) == []
