"""The smooth relative error of every model, as a term of the covariance."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rover_sweep.diagnosis.problem.model_error import COMMON, KNOTS, OWN, model_error
from rover_sweep.diagnosis.problem.residuals import Metric, Rows

LINES = np.geomspace(0.05, 10.0, 300)


def rows(run: int, channel: str, start: int) -> Rows:
    bins = np.arange(LINES.size)
    return Rows(run, channel, bins, LINES, np.ones(LINES.size), start)


def problem(modelled):
    """Two runs, one channel each with 2 * 300 rows; its model gives `modelled` (1200,)."""
    return SimpleNamespace(
        rows=(rows(0, "r", 0), rows(1, "r", 600)), plain_models=lambda structure, xs: [modelled]
    )


def lines(column, run):
    part = column[600 * run : 600 * (run + 1)]
    return part[:300] + 1j * part[300:]


FITTED = SimpleNamespace(structure=None, x={})
MODELLED = np.random.default_rng(3).normal(0.0, 50.0, 1200)


def columns():
    return np.column_stack([s.rows for s in model_error(problem(MODELLED), FITTED)])


def test_gain_and_phase_of_all_octaves_sum_to_the_response():
    found = model_error(problem(MODELLED), FITTED)
    common = [s for s in found if s.size == COMMON]
    for words, factor in (("gain of r", 1.0), ("phase of r", 1j)):
        whole = np.sum([s.rows for s in common if s.parameter.startswith(words)], axis=0)
        for run in (0, 1):
            assert lines(whole, run) == pytest.approx(COMMON * factor * lines(MODELLED, run))


def test_each_run_has_an_error_of_its_own():
    own = [s for s in model_error(problem(MODELLED), FITTED) if s.size == OWN]
    assert len(own) == 2 * 2 * KNOTS.size
    assert all(not s.rows[:600].any() or not s.rows[600:].any() for s in own)


def test_a_smooth_error_of_two_percent_counts_as_noise_and_a_sharp_one_does_not():
    metric = Metric.of_directions(columns())
    smooth = np.concatenate([_moved(run, 0.02 * np.sin(np.log2(LINES))) for run in (0, 1)])
    sharp = np.concatenate([_moved(run, np.where(abs(LINES - 3.0) < 0.2, 0.2, 0.0)) for run in (0, 1)])
    for rows_of, left in ((smooth, (0.0, 0.02)), (sharp, (0.4, 1.0))):
        share = float(np.sum(metric.of(rows_of) ** 2) / np.sum(rows_of**2))
        assert left[0] <= share <= left[1]


def test_a_run_alone_has_the_common_error_only():
    one = replace(rows(0, "r", 0))
    alone = SimpleNamespace(rows=(one,), plain_models=lambda structure, xs: [MODELLED[:600]])
    assert {s.size for s in model_error(alone, FITTED)} == {COMMON}


def _moved(run, share):
    z = share * lines(MODELLED, run)
    return np.concatenate([z.real, z.imag])
