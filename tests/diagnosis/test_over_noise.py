"""RMS over noise of a signature, also where the fit moved nothing (as for a 60 kg rover)."""

from __future__ import annotations

import numpy as np
import pytest

from rover_sweep.diagnosis.problem.residuals import over_noise


def test_a_fit_that_moves_nothing_is_at_the_noise() -> None:
    assert over_noise(0.0, np.zeros(100)) == over_noise(0.0, np.empty(0)) == 1.0


@pytest.mark.parametrize("size", [1e-30, 1.0, 1e20])
def test_the_size_of_the_signature_does_not_count(size: float) -> None:
    rows = np.zeros(100)
    rows[:4] = size
    assert over_noise(12.0, rows) == pytest.approx(2.0)  # 12 in 4 rows of variance 1: sqrt(1 + 3)


def test_a_negative_gain_counts_as_zero() -> None:
    assert over_noise(-5.0, np.ones(4)) == 1.0
