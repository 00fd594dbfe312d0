"""Models that run away: a lumped one may fit every response and still have an unstable pole."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE, driven

from rover_sweep.data.recording import Recording
from rover_sweep.identification.fit import Condition, FitResult, evaluated, sampled
from rover_sweep.identification.models import lumped, roll_yaw
from rover_sweep.identification.state_space import ModelStructure
from rover_sweep.identification.verdicts import reduce_model
from rover_sweep.identification.verify import verify
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.quality.coherence import responses

SHORT = Sweep(t_rec=25.0, w_min=0.6, w_max=25.0)


@pytest.fixture(scope="module")
def truth() -> ModelStructure:
    return roll_yaw(GEOMETRY).with_values(TRUE)


@pytest.fixture(scope="module")
def run(truth: ModelStructure) -> Recording:
    return driven(truth, SHORT, noise=0.003)


@pytest.mark.parametrize("l_p", [20.0, 200.0])
def test_a_model_that_runs_away_is_verified_as_useless_and_not_with_an_error(
    truth: ModelStructure, run: Recording, l_p: float
) -> None:
    stable = lumped(GEOMETRY, truth, 2.4)
    unstable = stable.with_values({"L_p": l_p})
    assert verify(stable, run).tic < 0.05
    assert unstable.poles(2.4).real.max() > 1
    found = verify(unstable, run)
    assert np.isfinite(found.j_rms) and found.j_rms > 100
    assert found.tic == pytest.approx(1.0, abs=0.02)


def test_reduction_keeps_what_a_stable_model_needs_to_stay_stable(
    monkeypatch: pytest.MonkeyPatch, truth: ModelStructure, run: Recording
) -> None:
    """Whatever the cost says, a drop may not turn a stable model unstable."""
    found = responses([run])
    data = tuple(sampled(f, f.band) for f in found.values() if f.band and f.output in ("r", "ay", "p"))
    condition = Condition(2.4, data, {})
    full = evaluated(lumped(GEOMETRY, truth, 2.4), [condition])

    def unstable_and_cheap(structure: ModelStructure, *_: object, **__: object) -> FitResult:
        moved = evaluated(structure.with_values({"L_p": 50.0}), [condition])
        return replace(moved, costs=full.costs)

    monkeypatch.setattr("rover_sweep.identification.verdicts.fit", unstable_and_cheap)
    best, steps = reduce_model(full, [condition])
    assert best is full
    assert steps and all(s.unstable and not s.dropped for s in steps)
