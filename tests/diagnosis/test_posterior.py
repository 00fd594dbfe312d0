"""Probabilities of explanations: what raises and lowers them, and what is named from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.diagnosis.posterior.infer import Options, _named, infer
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.posterior.unnamed import UnnamedFamily, families
from rover_sweep.diagnosis.posterior.weights import (
    COARSE,
    LEAST_GAIN,
    ExplanationEvidence,
    Posterior,
    SomethingElse,
    posterior,
)
from rover_sweep.diagnosis.problem.least_squares import sensitivities
from rover_sweep.diagnosis.problem.noise_floor import Floor, level_of
from rover_sweep.diagnosis.problem.residuals import never
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import logged
from rover_sweep.diagnosis.simulation.table_law import TableLaw, with_laws
from tests.diagnosis.planted import MODEL, NOISE, X, sweeps

ROWS, HELD_ROWS = 10_000, 1500


def explained(*effects: str, gain: float = 0.0, held: float = 0.0) -> ExplanationEvidence:
    """An explanation whose cost, and whose held-out rows, are lower than those of none by gain and held."""
    ids = frozenset(effects)
    cost, widths = ROWS - gain, tuple(0.02 for _ in effects)
    return ExplanationEvidence(ids, cost, float(ROWS), ROWS, HELD_ROWS - held, 1, widths, ids)


NONE = explained()


def of(*more: ExplanationEvidence, others: tuple[SomethingElse, ...] = ()) -> Posterior:
    return posterior((NONE, *more), HELD_ROWS, others)


def family(score: float) -> UnnamedFamily:
    law = TableLaw("yaw moment", "r", (-1.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    return UnnamedFamily(law, np.eye(3), np.array([score, 0.0, -score]), np.zeros((1, 3)))


def test_the_probabilities_are_those_of_all_that_could_be() -> None:
    found = of(explained("a", gain=100.0), explained("a", "b", gain=150.0))
    assert sum(w.probability for w in found.weighed) == pytest.approx(1.0)
    assert found.none == pytest.approx(1.0 - found.effects["a"])


def test_a_larger_gain_is_more_probable_and_held_out_rows_can_contradict_it() -> None:
    small, large = (of(explained("a", gain=g)).effects["a"] for g in (90.0, 250.0))
    assert small < large and large > 0.95
    against = of(explained("a", gain=250.0, held=-400.0)).effects.get("a", 0.0)
    assert against < 0.2 < of(explained("a", gain=90.0, held=200.0)).effects["a"]


def test_an_effect_that_gains_nothing_beside_another_is_not_named() -> None:
    found = of(explained("a", gain=400.0), explained("a", "b", gain=405.0))
    assert [e for e, _ in _named(found)] == ["a"]
    assert found.effects.get("b", 0.0) < 0.1
    unheld = [replace(e, widths=()) for e in (explained("a", gain=400.0), explained("a", "b", gain=400.0))]
    one, two = (w for w in of(*unheld).weighed if w.effects)
    assert one.effects == {"a"} and two.probability < 0.1, "a further effect is less probable from the start"


def test_two_that_explain_the_same_are_one_of_a_few() -> None:
    found = of(explained("a", gain=400.0), explained("b", gain=400.5))
    ((effect, others),) = _named(found)
    assert effect == "b" and set(others) == {"a"} and others["a"] == pytest.approx(0.49, abs=0.05)


def test_an_effect_of_no_size_is_present_and_does_not_matter() -> None:
    small = replace(explained("a", gain=300.0), material=frozenset())
    found = of(small)
    assert not found.effects and found.none > 0.99


def test_an_effect_of_little_gain_does_not_matter() -> None:
    """Narrow priors make it probable, and the gain alone keeps it from mattering."""
    little, enough = (
        replace(explained("a", gain=gain), widths=(0.999,), held=HELD_ROWS - 400.0)
        for gain in (0.9 * LEAST_GAIN, 1.1 * LEAST_GAIN)
    )
    assert of(little).none > 0.99 and not of(little).effects
    assert of(enough).effects["a"] > 0.9


def test_something_else_takes_the_names_that_it_explains_better() -> None:
    one = explained("a", gain=400.0)
    weak, strong = (
        of(one, others=(SomethingElse(one.effects, (family(score),), np.zeros(1)),)) for score in (0.1, 80.0)
    )
    assert weak.something_else < 0.2 and strong.something_else > 0.99
    assert strong.effects["a"] < 0.2 < weak.effects["a"]


def noisy(run: Experiment, model: Model, x: dict[str, float], random: np.random.Generator) -> Experiment:
    """The run as a rover of this model drives it, with noise."""
    true = logged(run, model, x)
    measured = {c: y + NOISE[c] * random.standard_normal(run.t.size) for c, y in true.items()}
    return replace(run, measured=measured)


def ranked(run: Experiment) -> list[UnnamedFamily]:
    """The families in what the model leaves of a run, the largest evidence first."""
    used, base = fit_with_floor([run], MODEL, X)
    found = families(used, sensitivities(used, base))
    return sorted(found, key=lambda f: -f.evidence(COARSE))


def test_a_curve_is_evidence_at_its_place() -> None:
    law = TableLaw("yaw moment", "r", (-1.4, -0.7, 0.0, 0.7, 1.4), (0.4, 0.1, 0.0, -0.1, -0.4))
    (run,) = sweeps(1, ((0.2, 2.2),))
    found = ranked(noisy(run, with_laws(MODEL, (law,)), X, np.random.default_rng(1)))
    assert found[0].evidence(COARSE) > 10.0
    assert "yaw moment" in {f.law.place for f in found[:4]}


def test_a_resonance_is_evidence_at_its_place_and_frequency() -> None:
    """A mast that sways at 2 Hz moves the accelerometer."""
    (run,) = sweeps(1, ((0.2, 2.2),))
    run = noisy(run, MODEL, X, np.random.default_rng(1))
    w = np.fft.rfftfreq(run.t.size, 1 / RATE) / 2.0
    sways = np.fft.irfft(np.fft.rfft(run.measured["ay"]) * 0.3 * w**2 / (1 - w**2 + 0.2j * w), run.t.size)
    best = ranked(replace(run, measured={**run.measured, "ay": run.measured["ay"] + sways}))[0]
    assert best.evidence(COARSE) > 10.0
    assert (best.law.place, best.law.memory) == ("sensor of ay", "resonance")
    assert 1.4 < best.law.size < 2.9


def test_noise_is_no_evidence() -> None:
    (run,) = sweeps(1, ((0.2, 2.2),))
    found = ranked(noisy(run, MODEL, X, np.random.default_rng(1)))
    assert found[0].evidence(COARSE) < 3.0


def test_a_late_velocity_is_named_in_its_form_with_its_delay() -> None:
    """A pure delay of the EKF's velocity, not the first-order lag that is tried first."""
    late = MODEL.with_effect("velocity_lag/delay")
    x, random = {**X, "velocity_lag.T": 0.2}, np.random.default_rng(1)
    runs = [noisy(run, late, x, random) for run in sweeps(1, ((0.1, 2.2),))]
    found = infer(runs, MODEL, X, Options(("velocity_lag",), (), lambda what, share: None, never))
    assert [n.law.name for n in found.named] == ["velocity_lag/delay"]
    assert found.last.fitted.x["velocity_lag.T"] == pytest.approx(0.2, abs=0.01)


def test_an_effect_of_the_model_that_it_begins_with_is_no_question() -> None:
    """The model of a comparison has the effects of the recordings already. Another effect is found too."""
    both = MODEL.with_effect("velocity_lag/delay").with_effect("steering_trim")
    x, random = {**X, "velocity_lag.T": 0.2, "trim": 0.05}, np.random.default_rng(1)
    runs = [noisy(run, both, x, random) for run in sweeps(1, ((0.1, 2.2),))]
    begin = MODEL.with_effect("velocity_lag/delay")
    found = infer(runs, begin, X, Options(("steering_trim",), (), lambda what, share: None, never))
    assert [n.law.id for n in found.named] == ["steering_trim"]
    assert found.minor == ()
    assert set(found.last.model.ids) == {"velocity_lag", "steering_trim"}
    assert all("velocity_lag" in e.model.ids for e in (found.none, found.last))


def test_the_noise_level_of_a_run_ignores_what_filters_took() -> None:
    """A gyro log at 200 Hz has hardly any noise above 12 Hz, where the floor is that of a good sensor."""
    (run,) = sweeps(1, ((0.1, 2.2),))
    run = replace(run, rates={"r": 200.0})
    f = np.arange(0.25, 50.0, 0.25)
    random = np.random.default_rng(2)
    slow = np.fft.rfft(random.standard_normal(run.t.size))
    at = np.fft.rfftfreq(run.t.size, 0.01)
    slow[at > 12.0] *= 1e-3
    residual = np.fft.irfft(slow, run.t.size)
    floor = Floor(f, {"r": np.where(f <= 12.0, 2.0 / 100.0, 1e-4)})
    assert level_of(run, {"r": residual}, floor)["r"] == pytest.approx(1.0, rel=0.15)
