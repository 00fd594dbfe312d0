"""Verdicts at the noise floor, what held-out runs contradict, and how much a finding matters."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from planted import MODEL, X, sweeps

from rover_sweep.data.results import Quantity
from rover_sweep.diagnosis.held_out import worse_by
from rover_sweep.diagnosis.posterior.weights import Posterior, Weighed
from rover_sweep.diagnosis.result import Diagnosis, Finding, Fit, HeldOut, TimeHistory, Unknown
from rover_sweep.diagnosis.simulation.simulator import FittedModel
from rover_sweep.diagnosis.verdict import (
    Turn,
    importance_words,
    refuted_words,
    remarks_of,
    sentence_of,
    turn_change,
    turn_sentence,
    turn_with,
    verdict_of,
    why_it_does_not_matter,
)

UNKNOWN = Unknown("r", "phi", 2.0, "r still differs", "residual of r ~ phi", 0.5)


def finding(*shares: float | None, after: float = 0.6) -> Finding:
    held = tuple(HeldOut(f"run{k + 4}", Fit(1.3, 0.1), Fit(after, 0.1), s) for k, s in enumerate(shares))
    value = Quantity("b", "rad", 0.01, 0.009, 0.011)
    return Finding("steering_backlash", (), (value,), {}, held, "", "backlash, b = .01 rad", "")


@pytest.mark.parametrize(
    ("findings", "left", "variance", "verdict"),
    [
        ((), None, 1.1, "none"),
        ((), None, 3.0, "none"),
        ((), UNKNOWN, 3.0, "unexplained"),
        ((finding(),), None, 1.1, "explained"),
        ((finding(),), None, 3.0, "partly explained"),
        ((finding(),), UNKNOWN, 3.0, "partly explained"),
    ],
)
def test_explained_is_at_the_noise_floor(
    findings: tuple[Finding, ...], left: Unknown | None, variance: float, verdict: str
) -> None:
    assert verdict_of(findings, left, variance) == verdict


def test_the_sentence_says_what_is_left_and_what_is_possible() -> None:
    assert "2.0 times the noise floor" in sentence_of((finding(),), None, 4.0)
    assert sentence_of((), None, 1.0).startswith("these runs show no missing effect")
    assert sentence_of((), None, 1.0, listed=True).startswith("nothing that matters was found")
    unsure = sentence_of((), None, 1.0, possible={"imu_offset": 0.67, "roll_steer": 0.12})
    assert unsure == "no effect is sure enough for a name; the most probable is imu_offset (67 %)"
    left = Unknown("r", "phi", 2.0, "r still differs; no candidate explains it; it has no pattern", "", None)
    found = sentence_of((finding(),), left, 3.0)
    assert found == "backlash, b = .01 rad, explains a part, but r still differs"
    assert sentence_of((), left, 3.0) == "r still differs, and no candidate explains it"


def test_a_finding_that_a_held_out_run_contradicts_is_reported() -> None:
    assert remarks_of([], [finding(0.4, -0.1, None)], {}, {}, {})[-1].endswith("worse on run5")
    assert not any("not confirmed" in remark for remark in remarks_of([], [finding(0.4, None)], {}, {}, {}))


@pytest.mark.parametrize(("slowest", "fastest", "told"), [(2.0, 2.1, True), (1.0, 3.0, False)])
def test_one_run_that_speeds_up_is_not_of_one_speed(slowest: float, fastest: float, told: bool) -> None:
    run = SimpleNamespace(speed=np.linspace(slowest, fastest, 3000), amplitude=0.2)
    found = remarks_of([run], [], {}, {}, {})  # type: ignore[list-item]
    assert any("the same speed" in remark for remark in found) == told


def test_effects_that_are_not_named_are_listed_with_the_reason() -> None:
    minor, listed = {"roll_steer": "it is below the size that matters"}, {"imu_offset": 0.42}
    found = remarks_of([], [], minor, listed, {})
    assert "roll_steer is present and does not matter: it is below the size that matters" in found
    assert "imu_offset is possible (42 %), but not sure enough for a name" in found
    said = refuted_words(("steering_backlash", 0.86))
    assert said.startswith("steering_backlash is rejected: it fits the runs (probability 86 %)")


def test_the_explanations_of_a_refuted_effect_stand_for_something_else() -> None:
    play, lag = "steering_backlash", "servo_lag"
    both = Weighed(frozenset({play, lag}), 0.7, {play: 1.0, lag: 1.0})
    alone = Weighed(frozenset({lag}), 0.2, {lag: 1.0})
    found = Posterior((both, alone, Weighed(frozenset(), 0.1, {}))).without(play)
    assert found.effects == {lag: pytest.approx(0.9)}
    assert (found.something_else, found.none) == (pytest.approx(0.7), pytest.approx(0.1))


@pytest.mark.parametrize(("error", "worse"), [(0.0, False), (0.02, False), (0.5, True), (-0.5, False)])
def test_worse_means_beyond_the_noise(error: float, worse: bool) -> None:
    noise, part = np.random.default_rng(1).standard_normal((2, 4000))
    before = noise + (0.5 * part if error < 0.0 else 0.0)
    after = noise + (error * part if error > 0.0 else 0.0)
    assert (worse_by(before, after) > 0.0) == worse


# ---- How much a finding matters: its part in a turn, and in the residual of a held-out run.


def turn_of(effect: str, **values: float) -> Turn | None:
    x = {**X, **{k.replace("__", "."): v for k, v in values.items()}}
    return turn_with(effect, FittedModel(MODEL.with_effect(effect), x), sweeps()[:1])


def test_a_transport_delay_is_added_to_the_start_of_each_turn() -> None:
    """0.12 s more than the normal 0.015 s: the same path later, V x 0.12 s apart."""
    turn = turn_of("transport_delay", delay=0.135)
    assert turn is not None
    assert turn.delay == pytest.approx(0.12, abs=0.01) and abs(turn.rate) < 0.01
    assert turn.turned == pytest.approx(np.pi / 2, abs=0.03)
    assert turn.path == pytest.approx(0.12 * turn.speed * np.sqrt(2), rel=0.15)
    words = turn_sentence(turn)
    assert "adds 0.12 s to its start" in words and words.endswith("m off")


def test_a_scale_makes_turns_tighter_and_what_does_not_move_the_rover_has_no_turn() -> None:
    turn = turn_of("steering_scale", scale=0.1)
    assert turn is not None and turn.rate == pytest.approx(0.1, abs=0.01) and abs(turn.delay) < 0.01
    assert turn_of("sensor_scale", sensor_scale__gyro=0.1) is None
    assert turn_of("clock_offset", delay=-0.1) is None
    assert turn_sentence(None) == ""


def test_an_effect_that_hardly_matters_says_so() -> None:
    friction, play = importance_words(finding(0.04, after=1.28)), importance_words(finding(0.87))
    assert "4 % of the squared residual above the noise on run4 (J_rms, with the noise: 1.3" in friction
    assert "hardly shows" in friction and "hardly shows" not in play and "87 %" in play


def test_an_effect_that_is_perhaps_absent_or_changes_neither_a_turn_nor_a_run_does_not_matter() -> None:
    assert why_it_does_not_matter(absent=True) == "the 90 % interval of its size includes zero"
    turn = Turn(2.2, 0.2, 1.5, delay=0.05, rate=0.0, path=0.1)
    still = replace(turn, delay=0.002, path=0.01)
    assert why_it_does_not_matter(False, still, 0.01) == "it changes no turn visibly"
    assert why_it_does_not_matter(False, turn, 0.01) == ""
    assert why_it_does_not_matter(False, still, 0.05) == "", "a servo that sticks shows in a run only"
    assert why_it_does_not_matter(False, None, 0.0) == "", "a sensor has no part in a turn"


def test_the_delay_and_the_gain_of_a_turn() -> None:
    t, w = np.arange(0.0, 30.0, 0.02), np.ones(2)
    before, after = np.sin(1.3 * t), 0.9 * np.sin(1.3 * (t - 0.12))
    overlay = TimeHistory("run4", "r", True, t, after, before, after, 0.01, w, w, w)
    late = Diagnosis("explained", "", "bicycle", findings=(finding(),), overlays=(overlay,))
    assert turn_change(late) == (pytest.approx(0.12, abs=0.004), pytest.approx(-0.1, abs=0.02))
    assert turn_change(replace(late, findings=())) is None
