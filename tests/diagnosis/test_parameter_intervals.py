"""Draws of a Gaussian between bounds, against draws without bounds of which those inside are kept."""

from __future__ import annotations

import numpy as np
import pytest

from rover_sweep.diagnosis.posterior.parameter_intervals import between_bounds


@pytest.mark.parametrize("at_bound", [0, 3, 7])
def test_draws_in_a_corner_of_the_bounds_are_those_of_the_cut_off_gaussian(at_bound: int) -> None:
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
