"""When an investigation is settled, what it asks the plan, and when it ends without an answer."""

from __future__ import annotations

from dataclasses import replace
from math import exp

import pytest
from fabricated import (
    DOUBLET,
    DRIVEN,
    MEANS,
    PLAY,
    SLOW,
    SWEEP,
    Ranking,
    explained,
    nothing_missing,
    unexplained,
)

from rover_sweep.diagnosis.plans.expected_posterior import NONE, OTHER
from rover_sweep.diagnosis.plans.plan import RunValue, effects_of
from rover_sweep.diagnosis.problem.least_squares import COARSE
from rover_sweep.diagnosis.result import Finding, UpperBound
from rover_sweep.investigation.decide import Means, first_run, next_step, times_over, told

ALIKE = replace(PLAY, look_alikes=("steering_deadband",))
PAIR = ("steering_backlash", "steering_deadband")
TELLS = RunValue(SLOW, 0.6, PAIR)


def test_the_first_set_is_one_sweep_and_one_doublet_that_is_held_out() -> None:
    first = first_run((), SWEEP, MEANS)
    assert first is not None and (first.action, first.run) == ("drive", SWEEP)
    second = first_run(DRIVEN[:1], SWEEP, MEANS)
    assert second is not None and second.run == DOUBLET and "held out" in second.reason
    assert first_run(DRIVEN, SWEEP, MEANS) is None


def test_a_confirmed_finding_without_look_alike_is_settled_and_nothing_is_planned() -> None:
    ranking = Ranking(TELLS)
    step = next_step(explained(PLAY), DRIVEN, MEANS, ranking)
    assert (step.action, step.run, step.effects) == ("settled", None, ("steering_backlash",))
    assert not ranking.asked


def test_look_alikes_get_the_run_that_is_expected_to_tell_most() -> None:
    ranking = Ranking(TELLS)
    step = next_step(explained(ALIKE), DRIVEN, MEANS, ranking)
    assert (step.action, step.run) == ("drive", SLOW)
    assert step.reason == (
        "steering_deadband explains the runs as well as steering_backlash; sweep of 240 us at 1.4 m/s "
        "is expected to settle it if steering_backlash or steering_deadband is true (0.6 bit expected)"
    )
    assert effects_of(ranking.asked[0]) == PAIR
    assert step.bits == 0.6 and set(PAIR) <= set(step.odds)


def removing(share: float | None) -> Finding:
    return replace(PLAY, held_out=(replace(PLAY.held_out[0], share_removed=share),))


@pytest.mark.parametrize(
    ("finding", "why"),
    [
        (replace(PLAY, probability=0.6), "the probability of steering_backlash is only 60 %"),
        (replace(removing(None), evidence={"held_out_gain": -2.0}), "held-out data do not confirm"),
        (removing(-0.1), "held-out data do not confirm steering_backlash"),
    ],
)
def test_a_doubtful_finding_is_compared_with_its_strongest_rival(finding: Finding, why: str) -> None:
    ranking = Ranking(replace(TELLS, settles=()))
    step = next_step(explained(finding), DRIVEN, MEANS, ranking)
    assert step.action == "drive" and step.reason.startswith(why)
    assert step.reason.endswith("tells most about steering_backlash and steering_deadband (0.6 bit expected)")
    odds = ranking.asked[0]
    assert odds["steering_backlash"] == finding.probability
    assert odds["steering_deadband"] == pytest.approx(1.0 - (finding.probability or 0.0))


def test_findings_must_be_probable_together() -> None:
    other = replace(PLAY, effect="roll_steer", probability=0.82)
    ranking = Ranking(TELLS)
    step = next_step(explained(PLAY, other), DRIVEN, MEANS, ranking)
    assert step.reason.startswith("the probability of all of steering_backlash, roll_steer is only 78 %")
    assert ranking.asked[0]["roll_steer"] == 0.82


def test_a_finding_that_no_held_out_run_tested_gets_a_doublet() -> None:
    step = next_step(explained(replace(PLAY, held_out=())), DRIVEN[:1], MEANS, Ranking())
    assert step.run == DOUBLET and "is not tested on a held-out run" in step.reason


def test_nothing_missing_is_settled_when_no_bound_matters_or_no_run_tells_more() -> None:
    assert next_step(nothing_missing(servo_lag=0.8), DRIVEN, MEANS, Ranking(TELLS)).action == "settled"
    ranking = Ranking()
    step = next_step(nothing_missing(servo_lag=1.8), DRIVEN, MEANS, ranking)
    assert step.action == "settled" and "no run is expected" in step.reason
    assert effects_of(ranking.asked[0]) == ("servo_lag",)
    step = next_step(nothing_missing(servo_lag=1.8), DRIVEN, MEANS, Ranking(RunValue(SLOW, 0.3)))
    assert step.run == SLOW and step.reason.endswith("tells most about servo_lag (0.3 bit expected)")


def test_odds_are_the_diagnosed_probabilities() -> None:
    """The effects without a probability share the rest as drops of the cost of 400 and 380 weigh."""
    found = replace(unexplained(), p_none=0.1, p_else=0.3)
    ranking = Ranking(TELLS)
    next_step(found, DRIVEN, MEANS, ranking)
    less = exp(-0.5 * 20.0 / COARSE)
    shares = {PAIR[0]: 0.6 / (1.0 + less), PAIR[1]: 0.6 * less / (1.0 + less)}
    assert ranking.asked[0] == pytest.approx({NONE: 0.1, OTHER: 0.3, **shares})


def test_what_has_no_name_is_never_settled_and_gets_a_new_operating_point() -> None:
    step = next_step(unexplained(PLAY), DRIVEN, MEANS, Ranking())
    assert step.run == SLOW and "a part of the residual has no name" in step.reason
    all_driven = (*DRIVEN, *MEANS.choices)
    assert next_step(unexplained(), all_driven, MEANS, Ranking()).action == "open"


@pytest.mark.parametrize(
    ("means", "why"),
    [
        (replace(MEANS, runs_left=0), "all runs that were allowed are driven"),
        (replace(MEANS, choices=()), "no run fits on the ground"),
        (replace(MEANS, spent="the battery has 9 % left"), "the battery has 9 % left"),
    ],
)
def test_runs_ground_and_battery_end_it(means: Means, why: str) -> None:
    ranking = Ranking(TELLS)
    step = next_step(explained(ALIKE), DRIVEN, means, ranking)
    assert (step.action, step.run) == ("used up", None) and why in step.reason and not ranking.asked
    first = first_run((), SWEEP, means)
    assert first is not None and first.action == "used up"
    assert next_step(explained(PLAY), DRIVEN, means, ranking).action == "settled"


def test_bounds_over_what_matters() -> None:
    assert times_over(UpperBound("s", 0.0, 0.14, 0.07)) == pytest.approx(2.0)
    assert times_over(UpperBound("-", 0.8, 1.25, 1.15)) == pytest.approx(1.6, abs=0.01)
    assert times_over(UpperBound("rad/s", 2.0, None, 4.0)) == pytest.approx(2.0)
    assert times_over(UpperBound("s", 0.0, 0.14, None)) == float("inf")


def test_a_run_told_as_many_bits_as_the_probabilities_moved() -> None:
    even = {"steering_backlash": 0.5, "steering_deadband": 0.5}
    sure = explained(replace(PLAY, probability=1.0))
    assert told(even, sure) == pytest.approx(1.0)
    still = replace(
        PLAY, probability=0.5, look_alikes=PAIR[1:], evidence={"probability:steering_deadband": 0.5}
    )
    assert told(even, explained(still)) == pytest.approx(0.0)
    assert told({"steering_backlash": 0.9, "steering_deadband": 0.1}, sure) < 0.2
    assert told({}, sure) == 0.0
