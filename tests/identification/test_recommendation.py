"""No model with unsound numbers is recommended, and the reason is said first."""

from __future__ import annotations

from dataclasses import replace
from math import nan
from pathlib import Path

import pytest
from synthetic import GEOMETRY, TRUE, driven

import rover_sweep as rs
from rover_sweep.data.recording import ASSUMED, LowPass, Note, Recording
from rover_sweep.identification import pipeline
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.model_results import recommendation
from rover_sweep.identification.models import roll_yaw
from rover_sweep.identification.pipeline import Identification, identify
from rover_sweep.identification.verdicts import ModelVerdict, judge_model
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.quality.faults import doubts

CONCEALED = Path(__file__).parents[1] / "data" / "concealed-ardurover" / "c"
SWEEP = Sweep(amplitude=120, t_rec=30, w_min=1.0)
TRUTH = roll_yaw(GEOMETRY).with_values(TRUE)
PHYSICAL = Settings(models=("bicycle", "roll-yaw"))
WITH_LUMPED = Settings(models=("bicycle", "roll-yaw", "lumped"))


@pytest.fixture(scope="module")
def run() -> Recording:
    return driven(TRUTH, SWEEP)


@pytest.fixture(scope="module")
def sound(run: Recording) -> Identification:
    return identify([run], GEOMETRY, [replace(run, name="check")], WITH_LUMPED)


def test_a_sound_model_is_recommended(sound: Identification) -> None:
    assert sound.recommended == "roll-yaw" and len(sound.summary) == 1


def test_the_costs_of_all_models_are_over_the_same_runs(run: Recording) -> None:
    """The lumped model is fitted at the first speed; its J holds the other run as well."""
    runs = [run, driven(TRUTH, SWEEP, speed=1.6)]
    models = identify(
        runs, GEOMETRY, settings=Settings(models=("roll-yaw", "lumped"), reduction=False)
    ).models
    lumped = models["lumped"]
    assert lumped.fit.average > 20 * models["roll-yaw"].fit.average
    assert lumped.average_all > lumped.fit.costs["r"] / 4
    where = lumped.verdict.sentences[-1]
    assert where.startswith("fitted at 2.40 m/s only, where J_ave is ")
    assert float(where.split()[-1]) < 0.1 * lumped.fit.average


def test_the_concealed_rover_gets_no_model() -> None:
    """Its lumped model fits two of three runs, with a derivative at a bound and J_rms 3."""
    runs = rs.read(*sorted(CONCEALED.glob("*.BIN")), vehicle=CONCEALED / "rover.toml")
    found = rs.identify(runs, models=("roll-yaw", "lumped"), bootstrap=0, reduction=False)
    assert found.recommended is None
    assert found.summary[0].startswith("no physical model fits these runs (roll-yaw, does not predict run4, ")
    assert found.summary[0].endswith("use `rover-sweep diagnose` to find what is left out")
    lumped = found.models["lumped"].verdict
    assert lumped.level == "poor" and "J_rms 3.04 (<= 2)" in lumped.sentences[0]
    assert any("at the bound of the fit's range" in words for words in lumped.sentences)


def test_a_model_that_predicts_a_run_with_a_large_error_is_not_recommended(run: Recording) -> None:
    """TIC forgives what J_rms does not: a yaw rate a quarter larger."""
    channels = dict(run.channels)
    channels["r"] = replace(channels["r"], x=1.25 * channels["r"].x)
    astray = replace(run, name="check", kind="other", channels=channels)
    found = identify([run], GEOMETRY, [astray], PHYSICAL)
    (check,) = found.models["roll-yaw"].verification
    assert check.tic < 0.35 and check.j_rms > 2.0
    assert found.recommended is None and "does not predict check, with TIC 0.1" in found.summary[0]


def test_a_derivative_at_its_bound_is_no_result(sound: Identification) -> None:
    fit = sound.models["roll-yaw"].fit

    def judged(name: str, value: float) -> ModelVerdict:
        ended = [replace(e, at_bound=True, value=value) if e.name == name else e for e in fit.estimates]
        return judge_model(replace(fit, estimates=tuple(ended)), physical=False)

    assert judged("b_phi", 36.0).level == "poor"
    assert judged("b_phi", 36.0).sentences[0].startswith("b_phi 36 N m s/rad at the bound")
    assert judged("tau", 0.5).level == "poor"


def test_a_model_whose_intervals_failed_is_not_recommended(
    run: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failed(models, *_):
        def without(m):
            return replace(m, fit=replace(m.fit, estimates=tuple(_lost(e) for e in m.fit.estimates)))

        return {name: without(m) for name, m in models.items()}

    monkeypatch.setattr(pipeline, "with_intervals", failed)
    found = identify([run], GEOMETRY, settings=PHYSICAL)
    assert found.recommended is None and "no interval of C: more than half" in found.summary[0]


def _lost(estimate):
    return (
        replace(estimate, low=nan, high=nan, sd=nan, bias=nan)
        if estimate.name in ("C", "L_eff")
        else estimate
    )


@pytest.mark.parametrize(
    ("slip", "check"), [({"mass": 26.6}, "Check mass first"), ({"roll_inertia": 0.125}, "Check roll_inertia")]
)
def test_an_implausible_vehicle_file_is_said_first(run: Recording, slip: dict, check: str) -> None:
    found = identify([run], replace(GEOMETRY, **{"yaw_inertia": 0.071, **slip}), settings=PHYSICAL)
    assert found.recommended is None
    assert found.summary[0].startswith("use none of these models: the vehicle file is implausible: ")
    assert check in found.summary[0]
    assert {found.models[n].verdict.level for n in PHYSICAL.models} == {"poor"}


def test_an_absurd_result_is_poor_however_well_it_fits() -> None:
    heavy = driven(roll_yaw(GEOMETRY).with_values({**TRUE, "Izz": 0.5}), SWEEP)
    found = identify([heavy], GEOMETRY, settings=PHYSICAL)
    model = found.models["roll-yaw"]
    assert model.fit.average < 10.0 and model.verdict.level == "poor"
    assert model.verdict.sentences[0].startswith("Izz = 0.") and found.recommended is None
    assert "radius of gyration in yaw / wheelbase is 1.1 (plausible: 0.2 to 0.75)" in found.summary[0]


def test_a_more_complete_model_is_not_passed_over_without_a_word(sound: Identification) -> None:
    poor = sound.models["roll-yaw"].lowered("poor", ("k_phi is odd",))
    best, sentences = recommendation({**sound.models, "roll-yaw": poor}, None)
    assert best == "bicycle" and sentences[1] == "the roll-yaw model is poor: k_phi is odd"


def test_a_lumped_model_that_fits_closer_is_not_passed_over_without_the_reason(sound: Identification) -> None:
    for cost, said in ((1.42, 1), (1.51, 0), (1.62, 0)):  # printed: 1.4, 1.5, 1.6
        models = {}
        for name, average in (("roll-yaw", 1.54), ("lumped", cost)):
            fit = sound.models[name].fit
            fit = replace(fit, costs=dict.fromkeys(fit.costs, average))
            models[name] = replace(sound.models[name], fit=fit)
        best, sentences = recommendation(models, None)
        assert best == "roll-yaw" and sentences[0].count(":") == 1
        assert [s.startswith("the lumped model has a lower J_ave") for s in sentences[1:]] == [True] * said


def test_data_that_are_not_whole_or_not_known_make_a_good_model_doubtful(run: Recording) -> None:
    cut = replace(run, name="cut", notes=(Note("warning", "The recording ends before the end of the run."),))
    assumed = replace(run, filters={"r": LowPass(20.0, ASSUMED), "ay": LowPass(20.0, "INS_ACCEL_FILTER")})
    assert not list(doubts([run])) and not list(doubts([cut, run]))
    settings = Settings(models=("bicycle",))
    for doubtful, why in (
        (cut, "no run was recorded completely (cut)"),
        (assumed, "the low-pass of r was not recorded"),
    ):
        verdict = identify([doubtful], GEOMETRY, settings=settings).models["bicycle"].verdict
        assert verdict.level == "acceptable" and verdict.sentences[0].startswith(why)
