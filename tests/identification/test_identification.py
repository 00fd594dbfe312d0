"""The whole core on runs whose answer is known."""

import numpy as np
import pytest
from synthetic import GEOMETRY, TRUE, driven, mirrored

from rover_sweep.data.recording import LowPass
from rover_sweep.identification.grouping import Settings
from rover_sweep.identification.models import roll_yaw
from rover_sweep.identification.pipeline import identify
from rover_sweep.identification.verify import verify
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.quality.coherence import excited_range
from rover_sweep.quality.verdict import assess
from rover_sweep.report.identification.sentences import first_numbers

SWEEP = Sweep(amplitude=120)
TRUTH = roll_yaw(GEOMETRY).with_values(TRUE)
SLOW_SENSORS = {"r": LowPass(4.0), "p": LowPass(4.0), "ay": LowPass(10.0)}


@pytest.fixture(scope="module")
def clean():
    return driven(TRUTH, SWEEP)


def test_parameters_come_back(clean):
    fit = identify([clean], GEOMETRY).models["roll-yaw"].fit
    for name, value in TRUE.items():
        assert fit[name].value == pytest.approx(value, rel=0.04), name
    assert fit.average < 1.0


def test_the_numbers_are_told_before_their_intervals(clean):
    told = []
    result = identify(
        [clean], GEOMETRY, settings=Settings(models=("roll-yaw",), bootstrap=100), fitted=told.append
    )
    first, last = told[0]["roll-yaw"].fit["C"], result.models["roll-yaw"].fit["C"]
    assert first.value == last.value
    assert first.interval_90 is None and last.interval_90 is not None
    words = first_numbers(told[0])
    assert words.startswith(f"first numbers, roll-yaw model: C {first.value:.3g} N/rad, ")
    assert words.endswith("; intervals follow")


def test_all_starts_reach_the_same_answer(clean):
    assert identify([clean], GEOMETRY).models["roll-yaw"].fit.spread < 1e-3


def test_known_filters_are_not_the_rovers_delay():
    run = driven(TRUTH, SWEEP, filters=SLOW_SENSORS)
    result = identify([run], GEOMETRY).models["roll-yaw"]
    assert result.fit["Izz"].value == pytest.approx(TRUE["Izz"], rel=0.04)
    assert result.fit["tau"].value == pytest.approx(TRUE["tau"], abs=0.003)
    ignored = result.variants["filters ignored"]
    assert ignored["Izz"].value > 1.3 * TRUE["Izz"]
    assert ignored["tau"].value > TRUE["tau"] + 0.03


def test_the_place_of_the_imu_matters(clean):
    from dataclasses import replace

    elsewhere = replace(GEOMETRY, imu_x=0.0, imu_z=0.08)
    right, wrong = (identify([clean], g).models["roll-yaw"].fit.average for g in (GEOMETRY, elsewhere))
    assert wrong > 5 * right + 1


def test_several_runs_sharpen_the_coherence():
    one = [driven(TRUTH, SWEEP, noise=0.03, seed=1)]
    two = [*one, driven(TRUTH, SWEEP, noise=0.03, seed=2)]
    low = [identify(runs, GEOMETRY).groups[0].responses["p"].random_error[10] for runs in (one, two)]
    assert low[1] < low[0]


def test_two_speeds_share_their_physical_parameters():
    runs = [driven(TRUTH, SWEEP, speed=v) for v in (1.6, 2.6)]
    result = identify(runs, GEOMETRY, settings=Settings(models=("bicycle", "roll-yaw")))
    assert [round(g.speed, 2) for g in result.groups] == [1.6, 2.6]
    assert result.models["roll-yaw"].fit["C"].value == pytest.approx(TRUE["C"], rel=0.015)


def test_the_wrong_sign_is_an_answer_with_a_reason(clean):
    result = identify([mirrored(clean)], GEOMETRY)
    assert result.recommended is None and not result.models
    assert "sign of rad_per_us" in result.summary[0]


def test_a_rover_without_roll_is_told_so():
    run = driven(TRUTH, SWEEP)
    rng = np.random.default_rng(3)
    from dataclasses import replace

    p = replace(run["p"], x=0.01 * rng.standard_normal(run["p"].x.size))
    result = identify([replace(run, channels={**run.channels, "p": p})], GEOMETRY)
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


def test_verification_of_the_truth_leaves_nothing(clean):
    verification = verify(TRUTH, clean)
    assert verification.tic < 0.02
    wrong = verify(TRUTH.with_values({"Izz": 2 * TRUE["Izz"]}), clean)
    assert wrong.tic > 3 * verification.tic


def test_verification_solves_the_biases(clean):
    from dataclasses import replace

    r = clean["r"]
    biased = replace(clean, channels={**clean.channels, "r": replace(r, x=r.x + 0.1)})
    verification = verify(TRUTH, biased)
    assert verification.tic < 0.02
