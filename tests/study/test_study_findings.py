"""Findings of the study against the numbers of the virtual rover; its texts follow the numbers."""

from dataclasses import replace

import pytest

from rover_sweep.study import findings
from rover_sweep.study import findings as parameter_findings
from rover_sweep.study.study_folder import all_findings, outcome_counts
from rover_sweep.study.virtual_study import Study


def swapped(done: Study, first: str, second: str) -> Study:
    """The study with two models' results exchanged in the fits made as the paper made them."""
    paper = done.paper
    models = dict(paper.result.models)
    models[first], models[second] = models[second], models[first]
    result = replace(paper.result, models=models)
    return replace(done, practices={**done.practices, "paper": replace(paper, result=result)})


def test_the_lumped_model_does_not_carry_to_another_speed_and_the_roll_yaw_does(done: Study) -> None:
    for practice in done.practices.values():
        nominal, fast = (
            {m: practice.check(m, c).tic for m in ("roll-yaw", "lumped")} for c in ("asphalt", "fast")
        )
        assert nominal["lumped"] < 0.1
        assert fast["lumped"] > 0.25 > 2 * fast["roll-yaw"]
    assert findings.fast(done).outcome == "came out"


def test_v_in_the_kinematic_term_alone_is_the_cause(done: Study) -> None:
    assert done.counterfactuals.frozen.tic > 2 * done.known.check("roll-yaw", "fast").tic


def test_ignoring_the_filters_costs_delay_and_cost(done: Study) -> None:
    for model in ("bicycle", "roll-yaw", "lumped"):
        paper, known = done.paper.fit(model), done.known.fit(model)
        assert 0.02 < paper["tau"].value - known["tau"].value < 0.056
        assert paper.average > 3 * known.average
    assert done.known.fit("roll-yaw")["tau"].value == pytest.approx(0.037, abs=0.004)


def test_known_filters_and_no_estimator_velocity_give_the_rover_back(done: Study) -> None:
    fit = done.practices["default"].fit("roll-yaw")
    true = done.truth.values
    for name, tolerance in (("k_phi", 0.06), ("b_phi", 0.06), ("Izz", 0.2)):
        assert fit[name].value == pytest.approx(true[name], rel=tolerance)
    assert fit["C"].value == pytest.approx((true["Cf"] + true["Cr"]) / 2, rel=0.04)


def test_the_estimators_lag_is_what_moves_izz(done: Study) -> None:
    true = done.truth.values["Izz"]
    assert done.known.fit("roll-yaw")["Izz"].value < 0.85 * true
    assert done.counterfactuals.prompt["Izz"].value == pytest.approx(true, rel=0.1)


def test_every_model_is_stable_where_it_was_fitted(done: Study) -> None:
    for practice in done.practices.values():
        for model in ("bicycle", "roll-yaw", "lumped"):
            assert practice.fit(model).structure.poles(practice.group.speed).real.max() < 1e-3


def test_outcomes_follow_the_numbers(done: Study) -> None:
    assert findings.cost_order(done).outcome == "came out"
    assert findings.cost_order(swapped(done, "lumped", "bicycle")).outcome != "came out"
    assert findings.nominal(done).outcome == "did not come out"
    assert findings.nominal(swapped(done, "lumped", "roll-yaw")).outcome == "came out"
    assert findings.fast(swapped(done, "lumped", "roll-yaw")).outcome == "did not come out"


def test_words_carry_the_numbers_they_are_about(done: Study) -> None:
    paper, known = (p.fit("roll-yaw")["tau"].value for p in (done.paper, done.known))
    text = parameter_findings.delays(done).text
    assert f"roll-yaw {1000 * paper:.0f} ms" in text and f"roll-yaw {1000 * known:.0f} ms" in text
    assert f"{done.paper.fit('lumped').average:.1f}" in findings.cost_order(done).text


def test_the_summary_counts(done: Study) -> None:
    found = all_findings(done)
    assert len({f.key for f in found}) == len(found)
    assert outcome_counts(found).startswith(f"{sum(f.outcome == 'came out' for f in found)} of {len(found)} ")
