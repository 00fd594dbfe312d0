"""The size up to which an effect that was not found could hide: it holds the truth, and little more."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import exp

import numpy as np
import pytest
from planted import MODEL, X, driven, shortened, sweeps

from rover_sweep.diagnosis import search
from rover_sweep.diagnosis.effects import library
from rover_sweep.diagnosis.posterior.model_fit import ModelFit, model_fit
from rover_sweep.diagnosis.posterior.upper_bounds import shown_length, sides, upper_bounds
from rover_sweep.diagnosis.result import Mismatch, Unseen, UpperBound, largest_hidden
from rover_sweep.diagnosis.simulation.candidates import possible

ONLY = ("front_rear_stiffness", "steering_backlash", "velocity_lag", "servo_rate_limit")
HIDDEN = -0.22  # ln Cf/Cr, beyond the normal tolerance of 0.15


@cache
def judged(ratio: float = HIDDEN) -> ModelFit:
    """Three sweeps of a rover whose rear axle is stiffer, too little to be found."""
    runs = driven(
        [shortened(run) for run in sweeps()], MODEL, {**X, "ln_ratio": ratio}, np.random.default_rng(3)
    )
    return model_fit(runs, MODEL, X, ONLY)


@cache
def bounds() -> dict[str, Unseen]:
    return {u.effect: u for u in upper_bounds(judged(), ONLY)}


def test_the_bound_holds_the_truth() -> None:
    ratio = bounds()["front_rear_stiffness"].up_to["ratio"]
    assert ratio.low is not None and ratio.high is not None and ratio.matters == pytest.approx(exp(0.15))
    assert 0.5 < ratio.low < exp(HIDDEN)  # each response may be wrong by 2 %
    assert 1.15 < ratio.high < 1.6


def test_every_effect_that_was_looked_for_has_its_bound() -> None:
    found = bounds()
    assert set(found) == set(ONLY)
    backlash, limit = found["steering_backlash"].up_to["b"], found["servo_rate_limit"].up_to["R"]
    assert backlash.low == 0.0 and 0.0 < (backlash.high or 0.0) < 0.02 and backlash.unit == "rad"
    assert limit.high is None and (limit.low or 0.0) > 1.0  # a faster servo does not show


def test_the_change_counts_from_the_normal_tolerance() -> None:
    found = bounds()
    assert (found["front_rear_stiffness"].change or 0.0) > 0.02
    assert found["velocity_lag"].change == 0.0  # neither r nor a_y
    assert all((u.change or 0.0) == 0.0 for u in found.values() if not u.material)
    assert not found["servo_rate_limit"].material


def test_an_ekf_hides_most_of_the_lag_of_its_gps() -> None:
    """A gain error of 16 % at 95 % is a lag of 0.5 s of a GPS that the EKF follows below 0.3 rad/s."""
    lag, gain = bounds()["velocity_lag"].up_to, judged().fitted.x["vy_gain"]
    assert lag["T_gps"].high == pytest.approx((1.645 * 0.1 - gain) / 0.3)
    assert (lag["T"].high or 1.0) < 0.05 < (lag["T_gps"].high or 0.0)


def test_both_signs_begin_at_the_ends_of_the_tolerance() -> None:
    more, less = sides(library()["front_rear_stiffness"], MODEL, ())
    assert (more.start, more.way, less.start, less.way) == (0.15, 1.0, -0.15, -1.0)


def test_understeer_shows_less_than_oversteer() -> None:
    """In a nominal rover the bound of a softer front axle is farther from 1 than that of a stiffer one."""
    (found,) = upper_bounds(judged(0.0), ("front_rear_stiffness",))
    ratio = found.up_to["ratio"]
    assert -np.log(ratio.low or 1.0) - 0.15 > 1.2 * (np.log(ratio.high or 1.0) - 0.15) > 0.0


def test_a_prior_takes_a_part_at_a_cost() -> None:
    """q/sqrt(s^2 + (q/L)^2): with L = 10 per unit and s = 0.5, 2 units show as 2/sqrt(0.25 + 0.01)."""
    assert shown_length(np.array([20.0]), 2.0, 0.5) == pytest.approx(2.0 / np.sqrt(0.26))
    assert shown_length(np.array([20.0]), 2.0, 0.0) == 20.0


def test_the_most_important_are_material_and_change_the_motion_most() -> None:
    up_to = {"x": UpperBound("m", None, 1.0)}
    some = [
        Unseen("a", "", up_to, 0.1),
        Unseen("b", "", up_to, 0.3),
        Unseen("c", "", up_to, 0.9, material=False),
        Unseen("d", "no channel"),
        Unseen("e", "", up_to, 0.04),
    ]
    assert [u.effect for u in largest_hidden(some)] == ["b", "a"]
    assert [u.effect for u in largest_hidden(some, 1)] == ["b"]
    ends = {(0.7, 1.2): 0.7, (-0.2, 0.3): 0.3, (12.0, None): 12.0, (0.0, 0.05): 0.05}  # the far one counts
    assert {span: UpperBound("-", *span).value for span in ends} == ends


def test_an_effect_that_the_baseline_includes_is_not_said_to_be_undetectable() -> None:
    found, unseen = possible(MODEL, judged().problem.runs)
    assert not {"tyre_slip", "roll_dof"} & {*unseen, *(e.id for e in found)}


def test_the_end_of_a_tolerance_is_said_only_where_the_fit_is_better_beyond_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    last = judged()
    c = next(c for c in last.fitted.free if c.name == "scale")
    at_end = replace(last.fitted, x={**last.fitted.x, c.name: c.high})
    for better, count in ((2 * c.high, 1), (0.9 * c.high, 0), (2 * c.low, 0)):
        freed = replace(at_end, x={**at_end.x, c.name: better}, cost=at_end.cost - 100.0)
        monkeypatch.setattr(search, "_freed", lambda *_, freed=freed: freed)
        assert len(search.at_the_end(last.problem, at_end)) == count, better


def test_many_numbers_at_their_ends_blame_the_model_and_not_the_owner() -> None:
    every = {name: f"{name} is at the end: measure it" for name in ("delay", "lag", "scale")}
    place = Mismatch("r", (2.0, 5.0), "throughout", 7.0, "yaw rate differs between 2 and 5 rad/s")
    assert search.many_at_the_end({n: every[n] for n in ("delay", "lag")}, [place]) == ()
    (words,) = search.many_at_the_end(every, [place])
    assert words.startswith("the model is wrong: 3 numbers") and "measure it" not in words
    assert "the servo's lag" in words and words.endswith("yaw rate differs between 2 and 5 rad/s")
