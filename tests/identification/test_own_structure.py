"""Structures of a user and several inputs, through the whole identification."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from synthetic import GEOMETRY, TRUE, driven

from rover_sweep.data.recording import Recording, Signal
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.models import bicycle
from rover_sweep.identification.pipeline import identify
from rover_sweep.identification.toml_form import structure_from_text
from rover_sweep.manoeuvre.sweep import Sweep

FILES = Path(__file__).parents[1] / "data" / "structures"
SWEEP = Sweep(amplitude=120)
BIKE = {n: TRUE[n] for n in ("C", "Izz", "tau")}
PULL, PULL_LAG, SHARE = 0.004, 0.3, 0.5  # yaw rate by throttle: rad/s per us and its lag, s
TEXT = """
name = "pulled"
states = ["beta", "r", "pull"]
inputs = ["delta", "throttle"]
outputs = ["r", "ay"]
[parameters]
C = { value = 20, unit = "N/rad", free = true, lower = 1, upper = 1000 }
Izz = { value = 0.1, unit = "kg m^2", free = true, lower = 0.01, upper = 1 }
tau = { value = 0.03, unit = "s", free = true, lower = 0, upper = 0.5 }
K = { value = 0.001, unit = "rad/s per us", free = true, lower = 1e-5, upper = 0.1 }
T = { value = 0.1, unit = "s", free = true, lower = 0.01, upper = 5 }
m = 2.66
a = 0.203
b = 0.188
x = 0.03
[matrices]
F = [
  ["-2*C/(m*V)", "-C*(a - b)/(m*V**2) - 1", 0],
  ["-C*(a - b)/Izz", "-C*(a**2 + b**2)/(Izz*V)", 0],
  [0, 0, "-1/T"],
]
G = [["C/(m*V)", 0], ["a*C/Izz", 0], [0, "K/T"]]
H0 = [[0, 1, 1], [0, "V", 0]]
H1 = [[0, 0, 0], ["V", "x", 0]]
"""


@pytest.fixture(scope="module")
def run() -> Recording:
    return driven(bicycle(GEOMETRY).with_values(BIKE), SWEEP, noise=0.002)


@pytest.fixture(scope="module")
def pulled(run) -> Recording:
    """The same with a throttle that moves with the steering (coherence .5) and turns the rover."""
    rng, t = np.random.default_rng(4), run["r"].t
    delta = run["delta"].on(t)
    spectrum = np.fft.rfft(delta)
    own = np.fft.irfft(np.abs(spectrum) * np.exp(2j * np.pi * rng.uniform(size=spectrum.size)), t.size)
    throttle = 500 * (np.sqrt(SHARE) * delta + np.sqrt(1 - SHARE) * own)
    c = 2 * PULL_LAG / (t[1] - t[0])
    r = run["r"].x + PULL * lfilter([1, 1], [1 + c, 1 - c], throttle)
    channels = {"r": replace(run["r"], x=r), "throttle": Signal(t, 1600 + throttle, "us")}
    return replace(run, channels={**run.channels, **channels})


def test_a_structure_is_fitted_beside_the_models(run):
    own = structure_from_text((FILES / "bicycle.toml").read_text())
    result = identify([run], GEOMETRY, [run], Settings(models=("bicycle",)), [own])
    built_in, of_file = result.models["bicycle"], result.models["bicycle-of-a-file"]
    for name in BIKE:
        assert of_file.fit[name].value == pytest.approx(built_in.fit[name].value, rel=1e-3)
    assert of_file.fit.average == pytest.approx(built_in.fit.average, rel=1e-3)
    assert of_file.verdict.level == built_in.verdict.level == "good"
    assert of_file.verification[0].tic == pytest.approx(built_in.verification[0].tic, rel=1e-3)


@pytest.mark.parametrize("ends, at_bound", [((-5.0, -1.0), True), ((-200.0, -1.0), False)])
def test_a_parameter_at_a_negative_bound_is_no_result(run, ends, at_bound):
    text = (FILES / "bicycle.toml").read_text(encoding="utf-8")
    law = '"-C*(a**2 + b**2)/(Izz*V)"'
    assert law in text
    low, high = ends
    more = f'Nr = {{ value = -3, unit = "1/s", free = true, lower = {low}, upper = {high} }}\n\n[matrices]'
    structure = structure_from_text(text.replace(law, '"Nr"').replace("\n[matrices]", more))
    found = identify([run], GEOMETRY, [], Settings(models=("bicycle",), bootstrap=20), [structure])
    result = found.models[structure.name]
    estimate = result.fit["Nr"]
    assert estimate.at_bound is at_bound
    assert (estimate.interval_90 is None) is at_bound
    assert not at_bound or result.verdict.level in ("poor", "not identifiable")


def test_conditioning_takes_the_throttle_out(pulled):
    models = ("bicycle",)
    paper = Settings(models=models, as_paper=True)
    plain = identify([pulled], GEOMETRY, settings=paper, structures=[structure_from_text(TEXT)])
    assert "--condition-on throttle" in plain.refused["pulled"]
    settings = Settings(models=models, condition_on=("throttle",), as_paper=True)
    cleaned = identify([pulled], GEOMETRY, settings=settings)
    response = cleaned.groups[0].responses["r"]
    assert response.conditioned_on == ("throttle",)
    assert "partial coherence (effect of throttle removed)" in cleaned.coherence[0].sentence
    truth = bicycle(GEOMETRY).with_values(BIKE).response(response.w, pulled.mean_speed, "r")
    inside = (response.w >= 0.6) & (response.w <= 20)
    ratio, spoilt = (g.groups[0].responses["r"].h[inside] / truth[inside] for g in (cleaned, plain))
    assert np.max(np.abs(20 * np.log10(np.abs(ratio)))) < 0.5
    assert np.max(np.abs(np.degrees(np.angle(ratio)))) < 5
    assert np.max(np.abs(20 * np.log10(np.abs(spoilt)))) > 1
    fits = [r.models["bicycle"].fit for r in (plain, cleaned)]
    off = [max(abs(f[n].value / v - 1) for n, v in BIKE.items()) for f in fits]
    assert off[1] < 0.05 and off[0] > 3 * off[1]


def test_a_structure_with_a_throttle_finds_what_it_does(pulled):
    own = structure_from_text(TEXT)
    settings = Settings(models=("bicycle",), condition_on=("throttle",))
    model = identify([pulled], GEOMETRY, [pulled], settings, [own]).models["pulled"]
    assert "r/throttle" in model.costs
    for name, value in {**BIKE, "K": PULL, "T": PULL_LAG}.items():
        assert model.fit[name].value == pytest.approx(value, rel=0.05), name
    assert model.verification[0].tic < 0.05


def test_a_throttle_that_stands_still_and_outputs_that_are_not_there_are_told(run):
    t = run["r"].t
    still = replace(run, channels={**run.channels, "throttle": Signal(t, np.full(t.size, 1600.0), "us")})
    text = TEXT.replace('"delta", "throttle"', '"delta"').replace(
        'outputs = ["r", "ay"]', 'outputs = ["p", "q"]'
    )
    text = text.replace('[["C/(m*V)", 0], ["a*C/Izz", 0], [0, "K/T"]]', '["C/(m*V)", "a*C/Izz", "K/T"]')
    settings = Settings(models=("bicycle",), condition_on=("throttle",))
    result = identify([still], GEOMETRY, settings=settings, structures=[structure_from_text(text)])
    assert "throttle is constant in these runs, so the responses are not conditioned on it" in result.summary
    assert result.groups[0].responses["r"].conditioned_on == ()
    assert "has the output 'q'; outputs can be r, ay, vydot, p" in result.refused["pulled"]


def test_two_models_of_one_name_are_refused(run):
    own = structure_from_text(TEXT.replace("pulled", "bicycle"))
    with pytest.raises(ValueError, match="a model named 'bicycle' exists"):
        identify([run], GEOMETRY, structures=[own])
