"""The whole core on runs whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE, driven, mirrored

from rover_sweep.data.recording import LowPass
from rover_sweep.identification.bootstrap import stiffness_loss
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.models import roll_yaw, roll_yaw_matrices
from rover_sweep.identification.pipeline import identify
from rover_sweep.identification.verify import verify
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.quality.coherence import excited_range, responses
from rover_sweep.quality.verdict import assess
from rover_sweep.report.identification.sentences import first_numbers

SWEEP = Sweep(amplitude=120)
TRUTH = roll_yaw(GEOMETRY).with_values(TRUE)
ROLL_YAW = Settings(models=("roll-yaw",))
SLOW_SENSORS = {"r": LowPass(4.0), "p": LowPass(4.0), "ay": LowPass(10.0)}


@pytest.fixture(scope="module")
def clean():
    return driven(TRUTH, SWEEP)


@pytest.fixture(scope="module")
def told():
    """The models as they were before their intervals."""
    return []


@pytest.fixture(scope="module")
def result(clean, told):
    settings = Settings(models=("bicycle", "roll-yaw"), bootstrap=20)
    return identify([clean], GEOMETRY, settings=settings, fitted=told.append)


def test_parameters_come_back_from_all_starts(result):
    fit = result.models["roll-yaw"].fit
    for name, value in TRUE.items():
        assert fit[name].value == pytest.approx(value, rel=0.04), name
    assert fit.average < 1.0 and fit.spread < 1e-3


def test_the_numbers_are_told_before_their_intervals(result, told):
    for name, model in result.models.items():
        assert all((e.interval_90 is not None) == e.free for e in model.fit.estimates), name
    first = told[0]["roll-yaw"].fit["C"]
    assert first.value == result.models["roll-yaw"].fit["C"].value and first.interval_90 is None
    words = first_numbers(told[0])
    assert words.startswith(f"first numbers, roll-yaw model: C {first.value:.3g} N/rad, ")
    assert words.endswith("; intervals follow")


def test_known_filters_are_not_the_rovers_delay():
    run = driven(TRUTH, SWEEP, filters=SLOW_SENSORS)
    result = identify([run], GEOMETRY, settings=ROLL_YAW).models["roll-yaw"]
    assert result.fit["Izz"].value == pytest.approx(TRUE["Izz"], rel=0.04)
    assert result.fit["tau"].value == pytest.approx(TRUE["tau"], abs=0.003)
    ignored = result.variants["filters ignored"]
    assert ignored["Izz"].value > 1.3 * TRUE["Izz"]
    assert ignored["tau"].value > TRUE["tau"] + 0.03


def test_the_place_of_the_imu_matters(clean, result):
    elsewhere = replace(GEOMETRY, imu_x=0.0, imu_z=0.08)
    wrong = identify([clean], elsewhere, settings=ROLL_YAW).models["roll-yaw"].fit.average
    assert wrong > 5 * result.models["roll-yaw"].fit.average + 1


def test_several_runs_sharpen_the_coherence():
    one, other = (driven(TRUTH, SWEEP, noise=0.03, seed=seed) for seed in (1, 2))
    errors = [responses(runs)["p"].random_error[10] for runs in ([one], [one, other])]
    assert errors[1] < errors[0]


def test_two_speeds_share_their_physical_parameters():
    runs = [driven(TRUTH, SWEEP, speed=v) for v in (1.6, 2.6)]
    result = identify(runs, GEOMETRY, settings=ROLL_YAW)
    assert [round(g.speed, 2) for g in result.groups] == [1.6, 2.6]
    assert result.models["roll-yaw"].fit["C"].value == pytest.approx(TRUE["C"], rel=0.015)


def test_the_wrong_sign_is_an_answer_with_a_reason(clean):
    result = identify([mirrored(clean)], GEOMETRY)
    assert result.recommended is None and not result.models
    assert "sign of rad_per_us" in result.summary[0]


def test_a_rover_without_roll_is_told_so(clean):
    run, rng = clean, np.random.default_rng(3)
    p = replace(run["p"], x=0.01 * rng.standard_normal(run["p"].x.size))
    settings = Settings(models=("roll-yaw", "lumped"))
    result = identify([replace(run, channels={**run.channels, "p": p})], GEOMETRY, settings=settings)
    assert set(result.refused) == {"roll-yaw", "lumped"}
    assert "roll rate does not follow" in result.refused["roll-yaw"]


def test_excited_range_is_the_swept_one(clean):
    low, high = excited_range([clean])
    assert low < 0.35
    assert high == pytest.approx(25, rel=0.1)


@pytest.mark.parametrize(("noise", "keep"), [(0.002, True), (0.5, False)])
def test_verdict_follows_the_noise(noise: float, keep: bool):
    verdict = assess(driven(TRUTH, SWEEP, noise=noise))
    assert verdict.keep is keep
    assert verdict.sentence.startswith("keep" if keep else "repeat with")


def test_the_asked_amplitude_is_enough():
    weak = assess(driven(TRUTH, Sweep(amplitude=20), noise=0.2))
    assert not weak.keep and weak.next.amplitude
    stronger = Sweep(amplitude=20 * weak.next.amplitude / weak.amplitude)
    assert assess(driven(TRUTH, stronger, noise=0.2, seed=5)).keep


def test_the_lumped_model_holds_for_skid_steering():
    """A yaw moment [N m] per rad of the steering command, and no side force."""

    def build(p):
        return replace(roll_yaw_matrices(p), g=np.array([0.0, 8.0, 0.0, 0.0]))

    rover = replace(TRUTH, build=build)
    settings = Settings(models=("lumped",))
    result = identify([driven(rover, Sweep(amplitude=150), noise=0.01)], GEOMETRY, settings=settings)
    fit = result.models["lumped"].fit
    assert result.recommended == "lumped" and fit.average < 5
    assert fit["N_delta"].value == pytest.approx(8.0 / TRUE["Izz"], rel=0.1)
    other = driven(rover, Sweep(amplitude=140, w_min=0.5, w_max=15, t_rec=10), noise=0.01, seed=9)
    assert verify(fit.structure, other).tic < 0.1


def test_grip_lets_the_stiffness_lose_less(clean):
    slippery, unknown, grippy = (stiffness_loss([clean], mu) for mu in (0.2, None, 0.9))
    assert slippery > unknown > grippy > 0.01
