"""J, J_rms, TIC and share removed on a held-out run, in total and for each effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted import MODEL, NOISE, X, driven, sweeps

from rover_sweep.diagnosis.held_out import HeldOutRun, compare_held_out
from rover_sweep.diagnosis.problem.least_squares import fit
from rover_sweep.diagnosis.problem.noise_floor import Floor
from rover_sweep.diagnosis.problem.residuals import with_floor
from rover_sweep.diagnosis.simulation.simulator import FittedModel, logged
from rover_sweep.identification.fit import ResponseData, weighted_errors

BOTH = MODEL.with_effect("tyre_relaxation").with_effect("steering_trim")
TRUE = {**X, "tyre_relaxation.sigma": 0.25, "trim": 0.02}
WHOLE, NOTHING = FittedModel(BOTH, TRUE), FittedModel(MODEL, {**X, "trim": 0.0})
F = np.linspace(0.25, 100.0, 400)
FLOOR = Floor(F, {c: np.full(F.size, 2 * s**2 / 200.0) for c, s in NOISE.items()})
# of a rover with relaxing tyres and a trim, with noise
RUN, *OTHERS = driven(sweeps(((0.1, 2.2), (0.1, 2.2), (0.15, 1.4))), BOTH, TRUE, np.random.default_rng(1))
HELD = HeldOutRun.of(RUN, FLOOR, WHOLE)


@pytest.mark.parametrize("factor", [10 ** (1 / 20), np.exp(1j * np.radians(7.57))])
def test_a_decibel_weighs_as_much_as_seven_degrees(factor: complex) -> None:
    h = np.full(20, 2.0 - 1.0j)
    data = ResponseData("r", np.geomspace(0.5, 20, 20), factor * h, np.ones(20))
    weight = (1.58 * (1 - np.exp(-1))) ** 2
    assert np.sum(weighted_errors(data, h) ** 2) == pytest.approx(20 * weight, rel=2e-3)
    assert np.sum(weighted_errors(data, data.h) ** 2) < 1e-9


def test_a_sweep_has_costs_and_a_doublet_has_none() -> None:
    found = compare_held_out(HELD, NOTHING, WHOLE)
    assert set(found.after.cost) == {"r", "ay", "p", "vydot"}
    assert all(found.after.cost[o] < 0.2 * found.before.cost[o] for o in found.after.cost)
    assert found.after.cost["r"] < 10 and found.before.cost["r"] > 100
    assert found.after.j_rms < found.before.j_rms and found.after.tic < found.before.tic
    assert found.share_removed == pytest.approx(1.0, abs=0.02)
    held = HeldOutRun.of(replace(RUN, kind="doublet"), FLOOR, WHOLE)
    doublet = compare_held_out(held, NOTHING, WHOLE)
    assert doublet.before.cost == {} and doublet.share_removed == found.share_removed


def test_a_quieter_run_is_judged_by_its_own_noise() -> None:
    """A run with half the noise of the used runs: the share removed refers to its own noise."""
    rest = FittedModel(BOTH, {**TRUE, "tyre_relaxation.sigma": 0.24})
    clean = logged(RUN, BOTH, TRUE)
    quiet = replace(RUN, measured={c: y + 0.5 * (RUN.measured[c] - y) for c, y in clean.items()})
    found = compare_held_out(HeldOutRun.of(quiet, FLOOR, WHOLE), rest, WHOLE)
    assert found.share_removed == pytest.approx(1.0, abs=0.1)


def test_a_model_at_the_floor_has_nothing_to_remove() -> None:
    assert compare_held_out(HELD, WHOLE, WHOLE).share_removed is None


def test_an_effect_counts_by_what_the_others_cannot_explain() -> None:
    """Without the trim the model still has relaxation, so the difference is the trim's contribution alone."""
    rest = fit(with_floor(OTHERS, FLOOR), BOTH.without("steering_trim"), TRUE)
    assert rest.model.effects == ("tyre_relaxation",)
    assert compare_held_out(HELD, rest, WHOLE).share_removed == pytest.approx(1.0, abs=0.1)
    left = [float(HELD.residual(m) @ HELD.residual(m)) for m in (WHOLE, rest, NOTHING)]
    assert left[0] < left[1] < left[2]
