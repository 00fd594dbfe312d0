"""The error of every model, as a term of the covariance."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from planted import MODEL, ROVER, X, shortened, sweeps

from rover_sweep.diagnosis.posterior.model_fit import (
    COMMON,
    HEIGHT,
    KNOTS,
    OWN,
    TRAIL,
    errors_of_coefficients,
    errors_of_responses,
    with_floor_of,
)
from rover_sweep.diagnosis.problem.least_squares import Fitted, columns, columns_of_runs
from rover_sweep.diagnosis.problem.residuals import Metric, Rows
from rover_sweep.diagnosis.simulation.table_law import TableLaw, with_laws

LINES = np.geomspace(0.05, 10.0, 300)


def rows(run: int, channel: str, start: int) -> Rows:
    bins = np.arange(LINES.size)
    return Rows(run, channel, bins, LINES, np.ones(LINES.size), start)


def problem(modelled):
    """Two runs, one channel each with 2 * 300 rows; its model gives `modelled` (1200,)."""
    return SimpleNamespace(
        runs=(0, 1),
        rows=(rows(0, "r", 0), rows(1, "r", 600)),
        rows_of=rows_of,
        plain_models=lambda model, xs: [modelled],
    )


def rows_of(run):
    return slice(600 * run, 600 * (run + 1))


def lines(column, run):
    part = column[600 * run : 600 * (run + 1)]
    return part[:300] + 1j * part[300:]


FITTED = SimpleNamespace(model=None, x={})
MODELLED = np.random.default_rng(3).normal(0.0, 200.0, 1200)
ERRORS = errors_of_responses(problem(MODELLED), FITTED)


def test_gain_and_phase_of_all_octaves_sum_to_the_response():
    common = [s for s in ERRORS if s.size == COMMON]
    for words, factor in (("gain of r", 1.0), ("phase of r", 1j)):
        whole = np.sum([s.rows for s in common if s.parameter.startswith(words)], axis=0)
        for run in (0, 1):
            assert lines(whole, run) == pytest.approx(COMMON * factor * lines(MODELLED, run))


def test_each_run_has_an_error_of_its_own():
    own = [s for s in ERRORS if s.size == OWN]
    assert [sum(s.run == run for s in own) for run in (0, 1)] == [2 * KNOTS.size] * 2
    for run in (0, 1):
        whole = np.sum([s.rows for s in own if s.run == run and s.parameter.startswith("gain")], axis=0)
        assert whole == pytest.approx(OWN * MODELLED[600 * run : 600 * (run + 1)])
    alone = SimpleNamespace(rows=(rows(0, "r", 0),), plain_models=lambda model, xs: [MODELLED[:600]])
    assert {s.size for s in errors_of_responses(alone, FITTED)} == {COMMON}, "a run alone"


def _moved(run, share):
    z = share * lines(MODELLED, run)
    return np.concatenate([z.real, z.imag])


def test_a_smooth_error_of_the_usual_size_counts_as_noise_and_a_sharp_one_does_not():
    shared = columns(ERRORS, MODELLED.size)
    own = [(rows_of(k), s) for k, s in enumerate(columns_of_runs(problem(MODELLED), ERRORS))]
    metric = Metric.of_columns(shared, own)
    smooth = np.concatenate([_moved(run, COMMON * np.sin(np.log2(LINES))) for run in (0, 1)])
    sharp = np.concatenate([_moved(run, np.where(abs(LINES - 3.0) < 0.2, 0.2, 0.0)) for run in (0, 1)])
    for wrong, left in ((smooth, (0.0, 0.02)), (sharp, (0.4, 1.0))):
        share = float(np.sum(metric.of(wrong) ** 2) / np.sum(wrong**2))
        assert left[0] <= share <= left[1]


def test_tolerances_of_each_run_and_of_all_have_the_covariance_of_their_sum():
    random = np.random.default_rng(5)
    shared, own = random.normal(size=(50, 3)), [random.normal(size=(20, 4)), random.normal(size=(30, 2))]
    metric = Metric.of_columns(shared, [(slice(0, 20), own[0]), (slice(20, 50), own[1])])
    covariance = np.eye(50) + shared @ shared.T
    covariance[:20, :20] += own[0] @ own[0].T
    covariance[20:, 20:] += own[1] @ own[1].T
    white = metric.of(np.eye(50))
    assert white @ covariance @ white.T == pytest.approx(np.eye(50), abs=1e-9)
    assert metric.of_small(np.eye(50)) == pytest.approx(white, abs=1e-5)


def test_an_error_of_a_coefficient_adds_what_the_same_force_adds_in_the_simulation():
    run = shortened(sweeps(((0.10, 2.0),))[0])
    found = with_floor_of([run], MODEL, X)
    free = MODEL.free
    fitted = Fitted(MODEL, X, free, 0.0, np.zeros(found.size), np.zeros((found.size, len(free))))
    errors = {s.parameter: s.rows for s in errors_of_coefficients(found, fitted)}
    assert set(errors) == {"trail", "roll axis front", "roll axis rear"}
    per_p = 35.0 * HEIGHT * ROVER.h / 2.0  # N s/rad at 2 m/s
    per_ay = TRAIL * ROVER.wheelbase * ROVER.mass  # N m/(m/s^2)
    for name, place, over, size in (
        ("roll axis front", "side force front", "p", per_p),
        ("roll axis rear", "side force rear", "p", per_p),
        ("trail", "yaw moment", "a_y", per_ay),
    ):
        small = 0.01
        law = TableLaw(place, over, (-50.0, 50.0), (-50.0 * small * size, 50.0 * small * size))
        added = found.model(with_laws(MODEL, [law]), X) - found.model(MODEL, X)
        wrong = np.linalg.norm(errors[name] * small - added) / np.linalg.norm(added)
        assert wrong < 0.03, f"{name}: {wrong:.3f}"
