"""Bootstrap intervals: the replicates are the pipeline's, the refit is the fit, the truth lies within."""

from dataclasses import replace

import numpy as np
import pytest
from coverage_draws import FILTERS, FITTED, TRUTH, clean_runs, disturbed, drawn
from synthetic import GEOMETRY, TRUE

from rover_sweep.data.recording import Signal
from rover_sweep.identification.bootstrap import Bootstrap
from rover_sweep.identification.fit import fit, sampled
from rover_sweep.identification.grouping import Settings, grouped
from rover_sweep.identification.models import bicycle, roll_yaw
from rover_sweep.identification.refit import forced_response, refitted_replicates
from rover_sweep.spectra.harmonics import ResidualSpectra, fresh_noise

NAMES = list(TRUE)


@pytest.fixture(scope="module")
def clean():
    return clean_runs(1)[0]


@pytest.fixture(scope="module")
def noisy(clean):
    """Groups, conditions and the fit of one noisy run."""
    groups = grouped([disturbed(clean, 1.0, np.random.default_rng(1))], Settings())
    conditions = [g.condition(FITTED) for g in groups]
    return groups, conditions, fit(roll_yaw(GEOMETRY), conditions)


def test_forced_response_is_that_of_an_integrator(clean):
    made = forced_response(TRUTH, 2.4, clean["delta"], clean.span, FITTED, 25.0, FILTERS)
    for name in FITTED:
        error = clean[name].x - made[name].on(clean[name].t)
        assert np.std(error) < 1e-3 * np.std(clean[name].x), name


def test_the_methods_own_bias_is_found(clean):
    """On a run without noise all that is wrong is the method, and the bootstrap must know it."""
    groups = grouped([clean], Settings())
    conditions = [g.condition(FITTED) for g in groups]
    found = fit(TRUTH, conditions)
    at_truth = Bootstrap(groups, conditions).estimates(replace(found, structure=TRUTH), 10, seed=0)
    for k, name in enumerate(NAMES):
        assert np.mean(at_truth[:, k]) == pytest.approx(found[name].value, rel=3e-3), name
    assert abs(found["b_phi"].value / TRUE["b_phi"] - 1) > 0.01  # there is a bias to be found


def test_a_refit_is_the_full_fit(noisy):
    groups, conditions, found = noisy
    made = Bootstrap(groups, conditions).groups[0](found.structure, 25, np.random.default_rng(0))
    quick = refitted_replicates(found.structure, conditions, [made])
    condition = conditions[0]
    for i in range(25):
        data = tuple(
            sampled(
                replace(
                    groups[0].responses[m.output],
                    h=np.exp(m.log_model + m.log_ratio[i]),
                    coherence=m.coherence[i],
                ),
                m.bands[i],
            )
            for m in made
        )
        full = fit(found.structure, [replace(condition, data=data)])
        assert np.all(np.abs(quick[i] - [full[n].value for n in NAMES]) < 0.05 * np.std(quick, axis=0))


def test_fresh_noise_has_the_spectra_of_the_residuals():
    rng = np.random.default_rng(0)
    t, n = np.arange(0, 60, 0.01), 6000
    common = rng.standard_normal(n)
    a, b = common + 0.5 * rng.standard_normal(n), 2 * common
    found = ResidualSpectra((0.0, 60.0), 25.0)([Signal(t, x, "-") for x in (a, b)])
    assert np.mean(found.density[:, 0, 0].real) == pytest.approx(1.25 * 0.01, rel=0.15)
    slow = np.linspace(0, 60, 600)
    made = fresh_noise(found, slow, 25.0, 40, [False, False], rng)
    power = np.mean(found.density[:, 1, 1].real) * 2 * 25.0 / (2 * np.pi)
    assert np.var(made[:, 1]) == pytest.approx(power, rel=0.1)
    between = np.corrcoef(made[:, 0].ravel(), made[:, 1].ravel())[0, 1]
    assert between == pytest.approx(1 / np.sqrt(1.25), abs=0.03)


def test_a_model_without_roll_uses_the_responses_that_it_has_and_a_seed_repeats(noisy):
    groups, conditions, _ = noisy
    found, maker = fit(bicycle(GEOMETRY), conditions), Bootstrap(groups, conditions)
    first, again, other = (maker.intervals(found, 20, seed=s) for s in (3, 3, 4))
    assert first == again != other and [i.name for i in first] == ["C", "Izz", "tau"]
    assert all(i.low < i.high and i.failed == 0 for i in first)


def test_the_spread_goes_with_the_noise_and_with_the_root_of_the_runs(clean):
    fixed = Settings(bands={"r": (0.3, 24), "ay": (0.3, 24), "p": (1.0, 24)})
    quiet, loud, twice = (
        drawn([clean] * runs, scale, 40, 2, fixed).intervals for scale, runs in ((0.5, 1), (1.5, 1), (1.5, 2))
    )
    for few, many, shared in zip(quiet, loud, twice, strict=True):
        assert many.sd / few.sd == pytest.approx(3.0, rel=0.35), few.name
        assert many.sd / shared.sd == pytest.approx(np.sqrt(2), rel=0.35), few.name
