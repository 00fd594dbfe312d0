"""Every fault in every phase of a run: what is promised holds; and what breaks without the rules."""

from __future__ import annotations

from pathlib import Path

import pytest
from virtual_fork import problems_of
from virtual_matrix import CASES, MOMENTS
from virtual_mutants import noticed, without

RULES = "rover_sweep.vehicle.run.right_to_move.RULES"


@pytest.mark.parametrize("moment", MOMENTS)
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
