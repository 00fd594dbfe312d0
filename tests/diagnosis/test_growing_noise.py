"""Dry friction holds the body still where the steering is quiet, so the noise grows with the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted import MODEL, NOISE, X, sweeps

from rover_sweep.diagnosis.posterior.infer import Options, infer
from rover_sweep.diagnosis.simulation.experiment import Experiment
from rover_sweep.diagnosis.simulation.simulator import logged
from rover_sweep.diagnosis.unexplained import left_unexplained

TORQUE = 0.02  # N m
EFFECT = "suspension_friction"


def runs(grows: float) -> list[Experiment]:
    """grows: noise of p while the body rolls, over that while it is still."""
    random, rubbed = np.random.default_rng(4), replace(MODEL, effects=(EFFECT,))
    out = []
    for run in sweeps(1):
        motion = logged(run, rubbed, {**X, f"{EFFECT}.T": TORQUE})
        rolling = np.convolve(np.abs(motion["p"]), np.full(200, 0.005), "same")
        noise = {c: s * random.standard_normal(run.t.size) for c, s in NOISE.items()}
        noise["p"] *= np.where(rolling > 0.3 * rolling.max(), grows, 1.0)
        out.append(replace(run, measured={c: y + noise[c] for c, y in motion.items()}))
    return out


@pytest.mark.slow
def test_a_finding_is_not_withdrawn_for_noise_that_grows_with_the_motion() -> None:
    found = infer(runs(2.0), MODEL, X, Options((EFFECT,), (), lambda what, share: None, lambda: False))
    assert [n.law.id for n in found.named] == [EFFECT]
    assert found.last.fitted.x[f"{EFFECT}.T"] == pytest.approx(TORQUE, rel=0.15)
    assert 1.45 < found.last.misfit["p"] < 1.8
    assert left_unexplained(found, True) is not None  # more than the noise where the body is still
