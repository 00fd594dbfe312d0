"""The ways in which a search can go wrong: stopped too early, begun too far off, nothing that fits."""

from pathlib import Path

import pytest

import rover_sweep as rs

SETS = Path(__file__).parents[1] / "data" / "concealed-ardurover"


def _runs(name: str, *numbers: int) -> rs.Runs:
    folder = SETS / name
    return rs.read(*(folder / f"run{k}.BIN" for k in numbers), vehicle=folder / "rover.toml")


def test_one_that_the_nominal_model_hides_is_found_from_its_plain_size() -> None:
    """Set c: C and Izz bent by 40 and 80 % leave a valley about no relaxation at all."""
    found = rs.diagnose(_runs("c", 1), only=("tyre_relaxation",))
    assert [f.effect for f in found.findings] == ["tyre_relaxation"]
    assert found.findings[0].parameters[0].value == pytest.approx(0.2276, rel=0.1)


def test_a_search_that_was_stopped_names_nothing_it_has_not_compared() -> None:
    found = rs.diagnose(_runs("c", 1), time_limit=0.01)
    assert found.verdict == "unexplained" and not found.findings
    assert any("time limit" in remark for remark in found.remarks)
    assert {u.effect for u in found.cannot_see if "not tried" in u.why} >= {
        "tyre_relaxation",
        "speed_variation",
    }


def test_without_the_true_effect_the_answer_is_no_other_name() -> None:
    """Set e hides dry friction of the suspension: nothing else may stand for it."""
    found = rs.diagnose(_runs("e", 1, 2), only=("steering_backlash", "roll_steer", "imu_offset"))
    assert found.verdict == "unexplained" and found.unknown is not None and not found.findings
