"""The diagnosis is a function of the data: the short form of `python -m tests.diagnosis.flips`."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

import rover_sweep as rs
from tests.diagnosis.flips import SAME_COST, Case, Told, changes, differences, told

SET = Path(__file__).parents[1] / "data" / "concealed-ardurover" / "c"


@cache
def case() -> Case:
    """One sweep with tyres that relax, from whose baseline a rounding once led elsewhere."""
    runs = rs.read(SET / "run3.BIN", vehicle=SET / "rover.toml")
    held = rs.read(SET / "run4.BIN", vehicle=SET / "rover.toml")
    return Case("c", runs, tuple(held), only=("tyre_relaxation", "steering_backlash"))


@cache
def plain() -> Told:
    return told(case())


def test_the_effect_is_found_from_a_base_that_is_far_off() -> None:
    assert plain().names == ("tyre_relaxation",)
    assert plain().numbers["tyre_relaxation.sigma"][0] == pytest.approx(0.2276, rel=0.05)


@pytest.mark.parametrize("name", ["mass x 1.000001", "noise", "start 1"])
def test_what_means_nothing_changes_nothing(name: str) -> None:
    other = dict(changes(case(), 1, False))[name](case())
    assert differences(plain(), other) == []
    if name == "start 1":
        assert other.cost == pytest.approx(plain().cost, rel=SAME_COST)
