"""A nominal parameter beyond its bound is reported; a proxy for it is not."""

from __future__ import annotations

from dataclasses import replace
from math import log

import numpy as np
import pytest
from planted import MODEL, NOISE, X, sweeps

from rover_sweep.diagnosis.choose import Choice, choose
from rover_sweep.diagnosis.search.bounds import unknown_at_bound
from rover_sweep.diagnosis.search.rounds import Options
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.diagnosis.simulation.simulator import Sensors, logged
from rover_sweep.diagnosis.unexplained.laws import laws
from rover_sweep.diagnosis.unexplained.unexplained import left_unexplained, unmodelled_gain

RATIO = 1.8  # Cf/Cr; 15 % are within the tolerances


def runs() -> list[Experiment]:
    random, x = np.random.default_rng(3), {**X, "ln_ratio": log(RATIO)}
    out = []
    for run in sweeps(1):
        motion = logged(run, MODEL.structure, x, Sensors.of(run))
        noisy = {c: y + NOISE[c] * random.standard_normal(y.size) for c, y in motion.items()}
        out.append(replace(run, measured=noisy))
    return out


def chosen(*only: str) -> Choice:
    return choose(runs(), MODEL, X, Options(only, (), 1, lambda what, share: None, lambda: False))


@pytest.mark.slow
def test_a_proxy_is_withdrawn() -> None:
    found = chosen("roll_steer")
    assert found.exceeded is not None and found.exceeded.coordinate == "ln_ratio"
    assert found.named == () and found.withdrawn == ("roll_steer",)
    answer = unknown_at_bound(found.exceeded, found.withdrawn)
    assert answer.depends_on == "the ratio of front to rear cornering stiffness"
    assert "explains more than roll_steer would" in answer.sentence and answer.residual_over_noise > 1.0


@pytest.mark.slow
def test_the_candidate_for_the_parameter_is_found() -> None:
    found = chosen("roll_steer", "front_rear_stiffness")
    assert found.exceeded is None and [n.trial.effect for n in found.named] == ["front_rear_stiffness"]
    assert np.exp(found.last.fitted.x["ln_ratio"]) == pytest.approx(RATIO, rel=0.1)


@pytest.mark.slow
def test_an_unnamed_term_counts_by_its_fitted_gain() -> None:
    """A wind turns the rover depending on its heading: no candidate does, but an unnamed term does."""
    law = next(w for w in laws() if w.term == "yaw moment ~ cos(psi)")
    windy = replace(MODEL.structure, effects=(law.effect,))
    random, blown = np.random.default_rng(5), {**X, law.effect.key("amount"): 0.2}
    recorded = []
    for run in sweeps(1):
        motion = logged(run, windy, blown, Sensors.of(run))
        noisy = {c: y + NOISE[c] * random.standard_normal(y.size) for c, y in motion.items()}
        recorded.append(replace(run, measured=noisy))
    options = Options(("roll_steer",), (), 1, lambda what, share: None, lambda: False)
    found = choose(recorded, MODEL, X, options)
    assert found.named == ()
    assert unmodelled_gain(found.first, 1) > 100.0
    answer = left_unexplained(found.last, False, 1, found.unmodelled)
    assert answer is not None and "psi" in answer.depends_on
