"""Structures written as text: the paper's models come out the same, and each mistake gets a sentence."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE

from rover_sweep.identification.fit import Condition, ResponseData, fit
from rover_sweep.identification.models import bicycle, roll_yaw
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.identification.toml_form import StructureError, parsed, structure_from_text

FILES = Path(__file__).parents[1] / "data" / "structures"
W = np.geomspace(0.3, 25, 20)
NAMES = {"C": "Cf", "tau": "lag"}  # what the roll-yaw file calls them

SMALL = """
name = "small"
states = ["r"]
inputs = ["delta", "throttle"]
outputs = ["r", "ay"]
[parameters]
T = { value = 0.2, unit = "s", free = true, lower = 0.01, upper = 2 }
K = { value = 5, unit = "1/s", free = true }
Kt = { tied = "-0.002 * K", unit = "rad/s per us" }
tau = { value = 0.03, unit = "s", free = true, lower = 0, upper = 0.5 }
late = { value = 0.1, unit = "s", free = true, lower = 0, upper = 1 }
slow = { tied = "late / 2", unit = "s" }
[matrices]
F = [["-1/T"]]
G = [["K/T", "Kt/T"]]
H0 = [[1], ["V"]]
[delays]
delta = "tau"
throttle = "late"
ay = "slow"
"""


def from_file(name: str) -> ModelStructure:
    return structure_from_text((FILES / f"{name}.toml").read_text())


def pairs() -> list[tuple[ModelStructure, ModelStructure, dict[str, str]]]:
    """(built in, of a file, the file's names for parameters), at different values than the starting ones."""
    bike = {n: TRUE[n] for n in ("C", "Izz", "tau")}
    roll = {NAMES.get(n, n): v for n, v in TRUE.items()}
    return [
        (bicycle(GEOMETRY).with_values(bike), from_file("bicycle").with_values(bike), {}),
        (roll_yaw(GEOMETRY).with_values(TRUE), from_file("roll-yaw").with_values(roll), NAMES),
    ]


@pytest.mark.parametrize(("built_in", "of_file", "names"), pairs())
def test_the_papers_models_answer_and_fit_the_same(built_in, of_file, names):
    for output in built_in.outputs:
        for speed in (1.2, 2.4):
            expected = built_in.response(W, speed, output)
            assert of_file.response(W, speed, output) == pytest.approx(expected, rel=1e-12)
    rng = np.random.default_rng(2)
    noise = np.exp(0.03 * (rng.standard_normal((4, W.size)) + 1j * rng.standard_normal((4, W.size))))
    data = tuple(
        ResponseData(o, W, built_in.response(W, 2.4, o) * noise[k], np.full(W.size, 0.95))
        for k, o in enumerate(built_in.outputs)
    )
    expected, found = (fit(structure, [Condition(2.4, data, {})]) for structure in (built_in, of_file))
    assert found.average == pytest.approx(expected.average, rel=1e-6)
    for e in (e for e in expected.estimates if e.free):
        ours = found[names.get(e.name, e.name)]
        assert ours.value == pytest.approx(e.value, rel=1e-4) and ours.unit == e.unit
        assert ours.cr_percent == pytest.approx(e.cr_percent, rel=1e-3)
        assert ours.insensitivity_percent == pytest.approx(e.insensitivity_percent, rel=1e-3)


def test_inputs_delays_and_ties():
    s = structure_from_text(SMALL)
    lag = 5 / (1 + 0.2j * W)
    assert s.response(W, 2.0, "r") == pytest.approx(lag * np.exp(-0.03j * W))
    assert s.response(W, 2.0, "r", input="throttle") == pytest.approx(-0.002 * lag * np.exp(-0.1j * W))
    assert s.response(W, 2.0, "ay", input="throttle") == pytest.approx(-0.004 * lag * np.exp(-0.15j * W))
    assert s.with_values({"K": 3}).values["Kt"] == pytest.approx(-0.006)


@pytest.mark.parametrize("input", ["delta", "throttle"])
@pytest.mark.parametrize("output", ["r", "ay"])
def test_sensitivities_follow_ties_and_delays(input: str, output: str):
    s = structure_from_text(SMALL)
    slopes = s.log_sensitivity(W, 2.0, output, input)
    for k, p in enumerate(s.free):
        step = 1e-5 * p.value
        up, down = (
            s.with_values({p.name: p.value + d}).response(W, 2.0, output, input=input) for d in (step, -step)
        )
        assert slopes[:, k] == pytest.approx(np.log(up / down) / (2 * step), rel=1e-5, abs=1e-7), p.name


def test_a_fit_to_two_inputs_finds_what_each_does():
    s = structure_from_text(SMALL)
    true = s.with_values({"T": 0.4, "K": 3.0, "tau": 0.05, "late": 0.2})
    data = tuple(
        ResponseData(o, W, true.response(W, 2.0, o, input=i), np.ones(W.size), i)
        for o in s.outputs
        for i in s.inputs
    )
    found = fit(s, [Condition(2.0, data, {})])
    assert set(found.costs) == {"r", "r/throttle", "ay", "ay/throttle"}
    for name in ("T", "K", "tau", "late", "Kt", "slow"):
        assert found[name].value == pytest.approx(true.values[name], rel=1e-4)
    assert not found["Kt"].free and found["Kt"].cr_percent is None


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("-1/T", "-1/Tx", "F row 1 column 1: '-1/Tx' uses 'Tx', which is no parameter"),
        ('F = [["-1/T"]]', 'F = [["-1/T", 0]]', "matrix F needs 1 rows of 1, not 1 of 2"),
        ('G = [["K/T", "Kt/T"]]', 'G = ["K/T"]', "matrix G must be a list of rows"),
        ('H0 = [[1], ["V"]]', "H0 = [[1]]", "matrix H0 needs 2 rows of 1"),
        ('["K/T", "Kt/T"]', '["2/T", "0.1/T"]', "K is free, but no matrix and no delay uses it"),
        ("-1/T", "__import__('os')", "is not allowed"),
        ("-1/T", "T.real", "'T.real', which is not allowed"),
        ("-1/T", "exp(T)", "'exp(T)', which is not allowed"),
        ("-1/T", "T if K else 1", "not allowed"),
        ("-1/T", "-1/", "is not a formula"),
        ("-1/T", "-1/(T - T)", "cannot be computed at the starting values"),
        ("-1/T", "9**9**9**9", "cannot be computed at the starting values"),
        ('"-0.002 * K"', '"K + 1"', "give a factor times one parameter"),
        ('"-0.002 * K"', '"2 * Q"', "Kt is tied to 'Q', which is not a parameter"),
        ('"late / 2"', '"Kt / 2"', "slow is tied to Kt, which is tied itself"),
        ('delta = "tau"', 'delta = "tao"', "the delay of delta is 'tao', which is not a parameter"),
        ('delta = "tau"', 'dleta = "tau"', "'dleta', which is neither input nor output"),
        ("lower = 0.01", "lower = 0.9", "T: need lower <= value <= upper, got 0.9, 0.2, 2"),
        ("K = { value = 5", "K = { value = '5'", "K: value is '5'; it must be a number"),
        ("K = { value = 5, ", "K = { ", "K needs either a value or a tie"),
        ("free = true }", "free = 1 }", "K: free is 1; it must be true or false"),
        ("K = {", "lambda = {", "parameter 'lambda' cannot be used in a formula"),
        ("T = {", "V = {", "parameter 'V' is the name of the speed"),
        ('name = "small"', 'name = "../small"', "use letters, digits"),
        ('states = ["r"]', 'states = "r"', "states is 'r'; give a list of names"),
        ('outputs = ["r"', 'output = ["r"', "unknown key 'output'"),
        ('inputs = ["delta", "throttle"]', 'inputs = ["throttle", "delta"]', "it must be the steering angle"),
        ('H0 = [[1], ["V"]]', 'H0 = [[0], ["V"]]', "no input affects the output r"),
        ('F = [["-1/T"]]', 'F = [["-1/T"]]\nM = [["T - 0.2"]]', "M has no inverse"),
        ("name =", "name", "not valid TOML"),
    ],
)
def test_each_mistake_gets_a_sentence(old: str, new: str, words: str):
    assert SMALL.count(old) >= 1
    with pytest.raises(StructureError) as caught:
        structure_from_text(SMALL.replace(old, new, 1))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    "text", ["True", "1j", "'a'", "a and b", "a < b", "[a]", "a // b", "a @ b", "(b := 1)", "x" * 600]
)
def test_formulas_hold_nothing_else(text: str):
    with pytest.raises(ValueError):
        parsed(text)


def test_formulas_are_analytic():
    formula = parsed("-(a*b**2 - 3e-1)/(+a + 2)")
    at = {"a": 1.5, "b": 0.7}
    step = 1e-20
    slope = formula({**at, "b": 0.7 + 1j * step}).imag / step
    assert slope == pytest.approx(-(2 * 1.5 * 0.7) / 3.5)
    assert formula.names == {"a", "b"}


def test_a_tie_leads_to_one_parameter():
    s = structure_from_text(SMALL)
    with pytest.raises(ValueError, match="tied to K, cannot be free"):
        s.with_free(["K", "Kt"])
    assert s.fixed("Kt", 1.0).with_values({"K": 9.0}).values["Kt"] == 1.0
    with pytest.raises(ValueError, match="delay 'none' is not a parameter"):
        replace(s, input_delays={"delta": "none"})
