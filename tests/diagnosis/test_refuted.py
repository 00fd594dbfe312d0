"""An effect that makes held-out runs worse is not named; what it explained counts as something else."""

from __future__ import annotations

import numpy as np
import pytest

from rover_sweep.diagnosis.held_out import worse_by
from rover_sweep.diagnosis.posterior.weights import Posterior, Weighed
from rover_sweep.diagnosis.verdict import refuted_words

PLAY, LAG = "steering_backlash", "servo_lag"


def test_its_explanations_stand_for_something_else() -> None:
    both = Weighed(frozenset({PLAY, LAG}), 0.7, {PLAY: 1.0, LAG: 1.0})
    alone = Weighed(frozenset({LAG}), 0.2, {LAG: 1.0})
    found = Posterior((both, alone, Weighed(frozenset(), 0.1, {}))).without(PLAY)
    assert found.effects == {LAG: pytest.approx(0.9)}
    assert found.something_else == pytest.approx(0.7)
    assert found.none == pytest.approx(0.1)


@pytest.mark.parametrize(("error", "worse"), [(0.0, False), (0.02, False), (0.5, True), (-0.5, False)])
def test_worse_means_beyond_the_noise(error: float, worse: bool) -> None:
    noise, part = np.random.default_rng(1).standard_normal((2, 4000))
    before = noise + (0.5 * part if error < 0.0 else 0.0)
    after = noise + (error * part if error > 0.0 else 0.0)
    assert (worse_by(before, after) > 0.0) == worse


def test_the_reason_is_said() -> None:
    assert refuted_words((PLAY, 0.86)).startswith("steering_backlash is not named: it fits the runs (86 %)")
