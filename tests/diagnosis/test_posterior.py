"""Probabilities of explanations: what raises and lowers them, and what is named from them."""

from __future__ import annotations

from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import pytest
from planted import MODEL, X, driven, shortened, sweeps

from rover_sweep.diagnosis.posterior.infer import Inference, Options, _named, infer
from rover_sweep.diagnosis.posterior.model_fit import fit_with_floor
from rover_sweep.diagnosis.posterior.parameter_intervals import between_bounds
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
from rover_sweep.diagnosis.problem.residuals import Problem, Stopped, never
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.table_law import TableLaw, with_laws

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


def short_runs(*plan: tuple[float, float]) -> list[Experiment]:
    return [shortened(run) for run in sweeps(plan)]


def ranked(run: Experiment) -> list[UnnamedFamily]:
    """The families in what the model leaves of a run, the largest evidence first."""
    used, base = fit_with_floor([run], MODEL, X)
    found = families(used, sensitivities(used, base))
    return sorted(found, key=lambda f: -f.evidence(COARSE))


def test_a_curve_is_evidence_at_its_place() -> None:
    law = TableLaw("yaw moment", "r", (-1.4, -0.7, 0.0, 0.7, 1.4), (0.4, 0.1, 0.0, -0.1, -0.4))
    found = ranked(*driven(short_runs((0.2, 2.2)), with_laws(MODEL, (law,)), X, np.random.default_rng(1)))
    assert found[0].evidence(COARSE) > 10.0
    assert "yaw moment" in {f.law.place for f in found[:4]}


def test_a_resonance_is_evidence_at_its_place_and_frequency_and_noise_is_none() -> None:
    """A mast that sways at 2 Hz moves the accelerometer."""
    (run,) = driven(short_runs((0.2, 2.2)), MODEL, X, np.random.default_rng(1))
    assert ranked(run)[0].evidence(COARSE) < 3.0
    w = np.fft.rfftfreq(run.t.size, 1 / RATE) / 2.0
    sways = np.fft.irfft(np.fft.rfft(run.measured["ay"]) * 0.3 * w**2 / (1 - w**2 + 0.2j * w), run.t.size)
    best = ranked(replace(run, measured={**run.measured, "ay": run.measured["ay"] + sways}))[0]
    assert best.evidence(COARSE) > 10.0
    assert (best.law.place, best.law.memory) == ("sensor of ay", "resonance")
    assert 1.4 < best.law.size < 2.9


LATE, LATE_X = MODEL.with_effect("velocity_lag/delay"), {**X, "velocity_lag.T": 0.2, "trim": 0.05}


def inferred(begin: Model, only: tuple[str, ...], **options: Any) -> Inference:
    """From one short sweep of a rover whose velocity is late and whose steering has a trim."""
    random = np.random.default_rng(1)
    runs = driven(short_runs((0.1, 2.2)), LATE.with_effect("steering_trim"), LATE_X, random)
    progress = options.get("progress", lambda what, share: None)
    return infer(runs, begin, X, Options(only, (), progress, options.get("stop", never)))


def test_a_late_velocity_is_named_in_its_form_with_its_delay_and_the_share_done_grows() -> None:
    """A pure delay of the EKF's velocity, not the first-order lag that is tried first."""
    shares: list[float] = []
    begin = MODEL.with_effect("steering_trim")
    found = inferred(begin, ("velocity_lag",), progress=lambda what, share: shares.append(share))
    assert [n.law.name for n in found.named] == ["velocity_lag/delay"] and not found.stopped
    assert found.last.fitted.x["velocity_lag.T"] == pytest.approx(0.2, abs=0.01)
    assert shares == sorted(shares)
    assert shares[0] == 0.0 and 0.6 < shares[-1] <= 0.92


def test_an_effect_of_the_model_that_it_begins_with_is_no_question() -> None:
    """The model of a comparison has the effects of the recordings already. Another effect is found too."""
    found = inferred(LATE, ("steering_trim",))
    assert [n.law.id for n in found.named] == ["steering_trim"]
    assert found.minor == ()
    assert set(found.last.model.ids) == {"velocity_lag", "steering_trim"}
    assert all("velocity_lag" in e.model.ids for e in (found.none, found.last))


@pytest.mark.parametrize("after", [0, 3, 25, 60])
def test_a_search_that_is_stopped_keeps_what_it_has_and_that_can_be_simulated(after: int) -> None:
    asked = count()
    found = inferred(MODEL, ("steering_trim", "velocity_lag"), stop=lambda: next(asked) >= after)
    assert found.stopped
    for part in (found.none, found.last):
        assert isinstance(part.problem, Problem)
        assert part.problem.model(part.model, part.fitted.x).shape == (part.problem.size,)
    assert all(one.law.id in found.last.model.ids for one in found.named)


def test_a_simulation_after_the_stop_raises() -> None:
    problem, fitted = fit_with_floor(short_runs((0.1, 2.2)), MODEL, X, near=True)
    with pytest.raises(Stopped):
        replace(problem, stop=lambda: True).model(fitted.model, fitted.x)


def test_the_noise_level_of_a_run_ignores_what_filters_took() -> None:
    """A gyro log at 200 Hz has hardly any noise above 12 Hz, where the floor is that of a good sensor."""
    run = replace(sweeps(((0.1, 2.2),))[0], rates={"r": 200.0})
    f = np.arange(0.25, 50.0, 0.25)
    random = np.random.default_rng(2)
    slow = np.fft.rfft(random.standard_normal(run.t.size))
    at = np.fft.rfftfreq(run.t.size, 0.01)
    slow[at > 12.0] *= 1e-3
    residual = np.fft.irfft(slow, run.t.size)
    floor = Floor(f, {"r": np.where(f <= 12.0, 2.0 / 100.0, 1e-4)})
    assert level_of(run, {"r": residual}, floor)["r"] == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize("at_bound", [0, 7])
def test_draws_in_a_corner_of_the_bounds_are_those_of_the_cut_off_gaussian(at_bound: int) -> None:
    """Against draws without bounds of which those inside are kept."""
    random = np.random.default_rng(0)
    root = random.standard_normal((10, 10))
    low = np.where(np.arange(10) < at_bound, 0.0, -50.0)
    found = between_bounds(root @ root.T, low, np.full(10, 50.0), seed=1)
    every = random.multivariate_normal(np.zeros(10), root @ root.T, 400_000)
    kept = every[np.all(every >= low, axis=1)]
    assert found.std(axis=0) == pytest.approx(kept.std(axis=0), rel=0.2)
    assert np.all(np.abs(found.mean(axis=0) - kept.mean(axis=0)) < 0.3 * kept.std(axis=0))


def test_a_coordinate_that_takes_anothers_place_keeps_its_bound() -> None:
    covariance = np.array([[1e4, 1e4 - 0.5], [1e4 - 0.5, 1e4]])
    found = between_bounds(covariance, np.array([-np.inf, -0.3]), np.array([np.inf, 0.3]), seed=1)
    assert np.std(found[:, 0]) == pytest.approx(1.02, rel=0.15)
