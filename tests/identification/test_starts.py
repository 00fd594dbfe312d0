"""The same answer from any start, or a warning that it is not."""

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE

from rover_sweep.identification.fit import Condition, FitResult, ResponseData, drawn_starts, fit, near_starts
from rover_sweep.identification.models import roll_yaw
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.identification.toml_form import structure_from_text
from rover_sweep.identification.verdicts import judge_model

W = np.geomspace(0.3, 25, 20)
HEAD = """
name = "twofold"
states = ["x", "r"]
outputs = ["r"]
[parameters]
"""
SWAPPED = (
    HEAD
    + """
T1 = { value = 0.2, unit = "s", free = true, lower = 0.001, upper = 10 }
T2 = { value = 0.3, unit = "s", free = true, lower = 0.001, upper = 10 }
[matrices]
F = [["-1/T1", 0], ["1/T2", "-1/T2"]]
G = ["1/T1", 0]
H0 = [[0, 1]]
"""
)
SQUARED = (
    HEAD
    + """
k = { value = 1, unit = "1/s", free = true, lower = -10, upper = 10 }
[matrices]
F = [["-1", 0], [1, "-2"]]
G = ["k**2 + 0.1", 0]
H0 = [[0, 1]]
"""
)


def answer(structure: ModelStructure, **true: float) -> list[Condition]:
    """The exact responses of a structure at other values."""
    other = structure.with_values(true)
    data = tuple(ResponseData(o, W, other.response(W, 2.4, o), np.ones(W.size)) for o in structure.outputs)
    return [Condition(2.4, data, {})]


def begun(structure: ModelStructure, conditions: list[Condition]) -> FitResult:
    return fit(structure, conditions, drawn_starts(structure))


@pytest.mark.parametrize(
    ("text", "true", "name"), [(SWAPPED, {"T1": 0.1, "T2": 0.5}, "T1"), (SQUARED, {"k": 2.0}, "k")]
)
def test_two_equal_minima_are_told(text: str, true: dict[str, float], name: str):
    structure = structure_from_text(text)
    found = begun(structure, answer(structure, **true))
    assert found.average < 1e-6
    assert found.starts == 4 and found.spread > 0.5
    words = judge_model(found).sentences
    assert any("not unique, since another start reaches the same cost" in s for s in words)
    if name == "k":
        assert found.spread_in == "k" and found.spread == pytest.approx(2.0, rel=1e-3)


def test_one_minimum_is_reached_from_any_start():
    structure = roll_yaw(GEOMETRY, tied=False)
    true = {**{n: v for n, v in TRUE.items() if n != "C"}, "Cf": 30.0, "Cr": 34.0}
    found = fit(structure, answer(structure, **true), drawn_starts(structure, count=6, seed=3))
    for name, value in true.items():
        assert found[name].value == pytest.approx(value, rel=1e-4)
    assert found.starts == 7 and found.spread < 1e-3 and not found.rivals
    assert not any("start" in s for s in judge_model(found).sentences)


def test_a_start_that_ends_elsewhere_is_told():
    """A delay begun a turn of the phase away ends there, at a higher cost that could pass for an answer."""
    text = (
        HEAD
        + """
tau = { value = 0.3, unit = "s", free = true, lower = 0, upper = 3 }
[matrices]
F = [["-1", 0], [1, "-2"]]
G = [1, 0]
H0 = [[0, 1]]
"""
    )
    structure = structure_from_text(text)
    w = np.geomspace(9, 10, 20)
    late = structure.response(w, 2.4, "r")
    condition = Condition(2.4, (ResponseData("r", w, late, np.ones(w.size)),), {})
    found = fit(structure, [condition], [{"tau": 0.3 + 2 * np.pi / 9.5}])
    assert found["tau"].value == pytest.approx(0.3, abs=1e-4)
    assert len(found.rivals) == 1 and found.rivals[0] > 1
    assert any("1 of 2 starts end in another minimum" in s for s in judge_model(found).sentences)


@pytest.mark.parametrize("draw", [drawn_starts, near_starts])
def test_starts_are_the_same_every_time_and_within_the_bounds(draw):
    structure = roll_yaw(GEOMETRY)
    first, again = draw(structure, count=20), draw(structure, count=20)
    assert first == again and first != draw(structure, count=20, seed=1)
    for p in structure.free:
        values = np.array([s[p.name] for s in first])
        assert np.all((values >= p.lower) & (values <= p.upper))
        assert np.ptp(values) > 0.5 * p.value


def test_signs_without_bounds_are_tried_both_ways():
    text = SQUARED.replace(", lower = -10, upper = 10", "")
    structure = structure_from_text(text)
    signs = {np.sign(s["k"]) for s in drawn_starts(structure, count=8)}
    assert signs == {-1.0, 1.0}
