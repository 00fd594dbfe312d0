"""Difficult searches: stopped early, started far from the solution, without a candidate that fits."""

from pathlib import Path

import pytest

import rover_sweep as rs

SETS = Path(__file__).parents[1] / "data" / "concealed-ardurover"


def _runs(name: str, *numbers: int) -> rs.Runs:
    folder = SETS / name
    return rs.read(*(folder / f"run{k}.BIN" for k in numbers), vehicle=folder / "rover.toml")


@pytest.mark.slow
def test_an_effect_hidden_by_the_nominal_fit_is_found_from_its_own_size() -> None:
    """Set c: the nominal fit is wrong by 40 % in C and 80 % in Izz, with a local minimum at no relaxation."""
    found = rs.diagnose(_runs("c", 1), only=("tyre_relaxation",))
    assert [f.effect for f in found.findings] == ["tyre_relaxation"]
    assert found.findings[0].parameters[0].value == pytest.approx(0.2276, rel=0.1)


def test_a_stopped_search_reports_no_finding_that_was_not_compared() -> None:
    found = rs.diagnose(_runs("c", 1), time_limit=0.01)
    assert found.verdict == "unexplained" and not found.findings
    assert any("time limit" in remark for remark in found.remarks)
    assert {u.effect for u in found.cannot_see if "not tried" in u.why} >= {
        "tyre_relaxation",
        "speed_variation",
    }


@pytest.mark.slow
def test_without_the_true_effect_no_other_effect_is_found() -> None:
    """Set e hides dry friction of the suspension: no other effect may be reported for it."""
    found = rs.diagnose(_runs("e", 1, 2), only=("steering_backlash", "roll_steer", "imu_offset"))
    assert found.verdict == "unexplained" and found.unknown is not None and not found.findings
