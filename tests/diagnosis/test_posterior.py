"""Probabilities of explanations: what raises and lowers them, and what is named from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.diagnosis.posterior.infer import _named
from rover_sweep.diagnosis.posterior.unnamed import UnnamedFamily, families
from rover_sweep.diagnosis.posterior.weights import ExplanationEvidence, Posterior, SomethingElse, posterior
from rover_sweep.diagnosis.problem.least_squares import fit, sensitivities
from rover_sweep.diagnosis.problem.noise_floor import Floor, level_of
from rover_sweep.diagnosis.problem.residuals import problem
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged
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


def test_two_that_explain_the_same_are_one_of_a_few() -> None:
    found = of(explained("a", gain=400.0), explained("b", gain=400.5))
    ((effect, others),) = _named(found)
    assert effect == "b" and set(others) == {"a"} and others["a"] == pytest.approx(0.49, abs=0.05)


def test_an_effect_of_no_size_is_present_and_does_not_matter() -> None:
    small = replace(explained("a", gain=300.0), material=frozenset())
    found = of(small)
    assert not found.effects and found.none > 0.99


def test_something_else_takes_the_names_that_it_explains_better() -> None:
    one = explained("a", gain=400.0)
    weak, strong = (
        of(one, others=(SomethingElse(one.effects, (family(score),), np.zeros(1)),)) for score in (0.1, 80.0)
    )
    assert weak.something_else < 0.2 and strong.something_else > 0.99
    assert strong.effects["a"] < 0.2 < weak.effects["a"]


def test_a_family_is_evidence_at_its_place() -> None:
    law = TableLaw("yaw moment", "r", (-1.4, -0.7, 0.0, 0.7, 1.4), (0.4, 0.1, 0.0, -0.1, -0.4))
    random, runs, noise = np.random.default_rng(1), [], []
    for run in sweeps(1, ((0.2, 2.2),)):
        mess = {c: s * random.standard_normal(run.t.size) for c, s in NOISE.items()}
        true = logged(run, with_laws(MODEL.structure, (law,)), X, Sensors.of(run))
        runs.append(replace(run, measured={c: y + mess[c] for c, y in true.items()}))
        noise.append(mess)
    found = problem(runs, noise)
    base = sensitivities(found, fit(found, MODEL.structure, MODEL.free, X, steps=3))
    every = sorted(families(found, base), key=lambda f: -f.evidence(8.0))
    assert every[0].evidence(8.0) > 10.0
    assert "yaw moment" in {f.law.place for f in every[:4]}


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
