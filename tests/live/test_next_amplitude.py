"""The amplitude that is proposed is the one that does: on made responses, and on the embedded rover."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rover_sweep.data.recording import Recording
from rover_sweep.logs.read import read_runs
from rover_sweep.manoeuvre.sweep import Sweep
from rover_sweep.quality.coherence import judged_responses, responses
from rover_sweep.quality.verdict import assess
from rover_sweep.spectra.amplitude import (
    WANTED_COHERENCE,
    AmplitudeProposal,
    Limit,
    averages,
    propose_amplitude,
    signal_to_noise,
)
from rover_sweep.spectra.response import FrequencyResponse
from rover_sweep.spectra.windowed import OVERLAP_CONSTANT
from tests.vehicle.simulated_drive import drive_simulated

W = np.geomspace(0.4, 25.6, 121)
MANY = 40.0  # averages


def made(ratio: np.ndarray, n_d: float = MANY, output: str = "r") -> FrequencyResponse:
    """A response whose signal-to-noise power ratio is known; its coherence has the bias of n_d averages."""
    true = ratio / (1 + ratio)
    independent = n_d / OVERLAP_CONSTANT**2
    g2 = true + (1 - true) / independent
    error = OVERLAP_CONSTANT * np.sqrt(1 - g2) / np.sqrt(2 * n_d * g2)
    h = np.full(W.size, 0.005 + 0j)
    return FrequencyResponse(
        "pwm", output, "rad/s per us", W, h, g2, error, W * 0, W * 0, (10.0,), (0.4, 25.6)
    )


def limit(words: str, us: np.ndarray | float) -> Limit:
    return Limit(words, W, np.broadcast_to(us, W.shape))


def test_signal_to_noise_comes_back_without_the_bias_of_few_averages() -> None:
    ratio = np.geomspace(30.0, 0.2, W.size)
    for n_d in (3.0, 12.0, 80.0):
        found = made(ratio, n_d)
        assert averages(found) == pytest.approx(np.full(W.size, n_d), rel=1e-6)
        assert signal_to_noise(found) == pytest.approx(ratio, rel=1e-6)


def test_each_octave_gets_the_amplitude_that_makes_its_coherence() -> None:
    ratio = np.where(W < 3.0, 36.0, 1.0)
    proposal = propose_amplitude({"r": made(ratio)}, 60.0)
    assert len(proposal.bands) == 6
    low, high = proposal.bands[0], proposal.bands[-1]
    assert low.wanted == pytest.approx(60.0 * np.sqrt(4.0 / 36.0))  # .8 is four to one
    assert high.wanted == pytest.approx(120.0) and high.reached == pytest.approx(WANTED_COHERENCE)
    assert proposal.amplitude == pytest.approx(120.0) and proposal.w_max is None
    assert proposal.sentence == "120 us: needed for r at 3.2-25.6 rad/s; below 3.2 rad/s 20 us is enough"


def test_few_averages_ask_for_more_than_the_coherence_does() -> None:
    few = propose_amplitude({"r": made(np.full(W.size, 4.0), n_d=2.5)}, 60.0).bands[0]
    assert few.wanted == pytest.approx(60.0 * np.sqrt(OVERLAP_CONSTANT**2 / (2 * 2.5 * 0.10**2) / 4.0))


def test_enough_is_enough_and_the_spare_is_told() -> None:
    proposal = propose_amplitude({"r": made(np.full(W.size, 4.2))}, 60.0)
    assert proposal.amplitude is None and proposal.sentence == "60 us is enough"
    much = propose_amplitude({"r": made(np.full(W.size, 64.0))}, 200.0)
    assert much.amplitude is None and much.sentence == "200 us is enough; 50 us would also be enough"
    assert (
        "80 us would also be enough"
        in propose_amplitude({"r": made(np.full(W.size, 64.0))}, 200.0, least=80.0).sentence
    )


def test_the_neediest_answer_decides() -> None:
    answers = {"r": made(np.full(W.size, 20.0)), "ay": made(np.full(W.size, 2.0), output="ay")}
    assert {band.response for band in propose_amplitude(answers, 50.0).bands} == {"ay"}


def test_a_limit_bites_with_a_word_and_tells_how_far_the_sweep_may_go() -> None:
    ratio = np.where(W < 6.4, 4.0, 0.5)
    servo = limit("the servo's rate", 2000.0 / W)  # 78 us at the top, 312 at 6.4 rad/s
    proposal = propose_amplitude({"r": made(ratio)}, 70.0, (limit("SWP_PWM_MAX", 250.0), servo))
    top = proposal.bands[-1]
    assert top.cap == "the servo's rate" and top.amplitude == pytest.approx(2000.0 / 25.6)
    assert top.wanted > top.amplitude and top.reached < WANTED_COHERENCE
    # at the top .38 is all that can be reached; an octave below the servo allows enough for a usable .71
    assert proposal.w_max == pytest.approx(12.8) and proposal.amplitude == pytest.approx(2000.0 / 12.8)
    assert "the servo's rate allows 78 us" in proposal.sentence
    assert proposal.bands[0].cap == ""


def test_where_nothing_answers_the_proposal_is_a_lower_bound() -> None:
    rng = np.random.default_rng(3)
    w = np.zeros(W.size) + 1e-9 * rng.random(W.size)
    proposal = propose_amplitude({"r": made(w)}, 20.0)
    assert all(band.drowned for band in proposal.bands)
    assert proposal.sentence.startswith("at least ")


@pytest.mark.slow
def test_driven_with_what_was_proposed_the_coherence_is_what_was_forecast(tmp_path: Path) -> None:
    def proposal_after(amplitude: float) -> tuple[Recording, AmplitudeProposal]:
        folder = tmp_path / f"{amplitude:g}"
        list(drive_simulated({"sweep1": Sweep(amplitude=amplitude)}, folder, seed=7))
        (run,) = read_runs(str(folder / "sweep1.tlog"))
        return run, assess(run).next

    forecast = proposal_after(60.0)[1]
    assert forecast.amplitude is not None and 70.0 < forecast.amplitude < 120.0
    run, again = proposal_after(round(forecast.amplitude))
    assert again.amplitude is None or again.amplitude < 1.25 * again.driven, "it asks for no more"
    found = judged_responses(responses([run], input="pwm"))
    for band in forecast.bands:
        f = found[band.response]
        inside = (f.w >= band.low) & (f.w <= band.high)
        gain = (forecast.amplitude / forecast.driven) ** 2
        expected = 1 / (1 + band.noise_to_signal / gain)
        assert float(np.median(f.coherence[inside])) == pytest.approx(expected, abs=0.08)
        assert np.median(f.coherence[inside]) > WANTED_COHERENCE - 0.08
        assert np.median(f.random_error[inside]) < 0.12
