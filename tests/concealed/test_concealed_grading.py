"""The rules of the proof, case by case."""

from __future__ import annotations

from typing import Any

import pytest

from tests.concealed.effects import UNKNOWN, draw_effect, ids, table
from tests.concealed.grade import grade
from tests.concealed.sets import draw_case, kinds, stream
from tests.concealed.summary import print_summary, wilson


def finding(
    effect: str, *alike: str, value: float = 1.0, low: float = 0.9, high: float = 1.2
) -> dict[str, Any]:
    parameters = {"b": {"value": value, "unit": "rad", "low": low, "high": high}}
    return {
        "effect": effect,
        "look_alikes": list(alike),
        "parameters": parameters,
        "evidence": {},
        "held_out": {"run": "run4", "share_removed": 0.8},
        "next_run": "",
    }


def mark(kind: str, hidden: tuple[str, ...], *found: dict[str, Any], unknown: Any = None) -> str:
    truth = {"kind": kind, "effects": [{"effect": name, "parameters": {"b": 1.0}} for name in hidden]}
    answer = {"verdict": "explained" if found else "none", "findings": list(found), "unknown": unknown}
    return grade("0001", truth, answer, 1.0).mark


BACKLASH, RELAXATION = finding("steering_backlash"), finding("tyre_relaxation")


@pytest.mark.parametrize(
    ("expected", "hidden", "found"),
    [
        ("exact", ("steering_backlash",), (BACKLASH,)),
        ("exact", ("steering_backlash",), (finding("steering_backlash", "steering_deadband"),)),
        ("look-alike", ("steering_backlash",), (finding("steering_deadband"),)),
        ("look-alike", ("cross_slope",), (finding("imu_tilt", "cross_slope"),)),
        ("wrong", ("steering_backlash",), (BACKLASH, RELAXATION)),
        ("wrong", ("steering_backlash",), (finding("steering_backlash", "a", "b", "c"),)),
        ("wrong", ("steering_backlash",), (RELAXATION,)),
        ("wrong", ("steering_backlash",), (BACKLASH, finding("steering_deadband"))),
        ("missed", ("steering_backlash",), ()),
        ("missed", ("tyre_slip", "roll_dof"), (finding("tyre_slip"),)),
        ("exact", ("tyre_slip", "roll_dof"), (finding("roll_dof"), finding("tyre_slip"))),
    ],
)
def test_one_effect(expected: str, hidden: tuple[str, ...], found: tuple[dict[str, Any], ...]) -> None:
    assert mark("single", hidden, *found) == expected


def test_other_kinds() -> None:
    two = ("steering_backlash", "tyre_relaxation")
    assert mark("double", two, RELAXATION, BACKLASH) == "both"
    assert mark("double", two, RELAXATION) == "one"
    assert mark("double", two, RELAXATION, finding("roll_steer")) == "wrong"
    assert mark("none", ()) == "none"
    assert mark("none", (), BACKLASH) == "false alarm"
    assert mark("unknown", ("side_wind",), unknown={"channel": "r"}) == "unknown"
    assert mark("unknown", ("side_wind",), finding("cross_slope")) == "nearest"
    assert mark("unknown", ("side_wind",), finding("cross_slope"), BACKLASH) == "wrong"
    assert mark("unknown", ("side_wind",)) == "missed"
    assert mark("deleted", ("steering_backlash",), unknown={"channel": "r"}) == "unknown"
    assert mark("deleted", ("steering_backlash",), finding("steering_deadband")) == "look-alike"
    assert mark("deleted", ("steering_backlash",), RELAXATION, unknown={"channel": "r"}) == "wrong"
    assert mark("deleted", ("steering_backlash",)) == "missed"
    truth = {"kind": "none", "effects": []}
    assert grade("1", truth, {"verdict": "failed", "findings": [], "unknown": None}, 1.0).mark == "failed"


def test_parameters_and_share_are_judged_where_the_name_is_right() -> None:
    truth = {"kind": "single", "effects": [{"effect": "steering_backlash", "parameters": {"b": 0.8}}]}
    answer = {
        "verdict": "explained",
        "findings": [BACKLASH],
        "unknown": None,
        "held_out": [{"run": "run4", "share_removed": 0.8}],
    }
    one = grade("0001", truth, answer, 1.0)
    assert one.errors == (pytest.approx(0.25),) and one.covered == (False,) and one.share == 0.8
    mix = {"kind": "single", "effects": [{"effect": "imu_offset", "parameters": {"x": 0.03, "z": 0.04}}]}
    off = {
        **BACKLASH,
        "effect": "imu_offset",
        "parameters": {
            "x": {"value": 0.03, "unit": "m", "low": 0.0, "high": 0.1},
            "z": {"value": 0.05, "unit": "m", "low": 0.0, "high": 0.1},
        },
    }
    judged = grade("0001", mix, {**answer, "findings": [off]}, 1.0)
    assert judged.errors == (pytest.approx(0.2),) and judged.covered == (True, True)


def test_wilson_interval_is_the_published_one() -> None:
    low, high = wilson(8, 10)  # Wilson 1927, as in any table: 0.490 to 0.943
    assert (low, high) == (pytest.approx(0.490, abs=5e-4), pytest.approx(0.943, abs=5e-4))
    assert wilson(0, 50)[0] == 0.0 and wilson(0, 50)[1] == pytest.approx(0.071, abs=1e-3)


def test_summary_counts_every_set_once(capsys: pytest.CaptureFixture[str]) -> None:
    truth = {"kind": "single", "effects": [{"effect": "steering_backlash", "parameters": {"b": 1.0}}]}
    answers = [[BACKLASH], [finding("steering_deadband")], [RELAXATION], []]
    said = [{"verdict": "explained", "findings": found, "unknown": None} for found in answers]
    print_summary([grade(f"{k}", truth, one, 1.0) for k, one in enumerate(said)])
    text = capsys.readouterr().out
    assert "exact                                             1/4" in text
    assert "exact or look-alike                               2/4" in text
    assert "steering_backlash 1, steering_deadband 1, tyre_relaxation 1, explained 1" in text


def test_kinds_hide_nothing_in_about_a_third() -> None:
    drawn = kinds(2000, 5, "all")
    assert 0.27 < drawn.count("none") / 2000 < 0.33
    assert {"none", "single", "double", "unknown"} == set(drawn)
    assert kinds(3, 5, "all", "side_wind") == ["unknown"] * 3


def test_doubles_are_two_effects_that_can_be_told_apart() -> None:
    for number in range(1, 60):
        case = draw_case(8, number, "double")
        names = [one.id for one in case.hidden]
        assert len(set(names)) == 2 and case.baseline == "roll-yaw"
        assert names[1] not in table()["look_alikes"].get(names[0], [])


def test_factor_makes_an_effect_stronger_in_its_own_direction() -> None:
    rover = draw_case(8, 1, "none").rover
    for effect in (*ids(), *UNKNOWN):
        weak, strong = (draw_effect(effect, k, rover, stream(1, 1, 1)).parameters for k in (1.0, 2.0))
        scaling = (table().get(effect) or table()["unknown"][effect]).get("scaling", "proportional")
        for name in (n for n in weak if n not in ("t", "psi0") and scaling != "own"):
            ratio = strong[name] / weak[name]
            expected = {"proportional": 2.0, "inverse": 0.5, "ratio": weak[name]}[scaling]
            assert ratio == pytest.approx(expected)
