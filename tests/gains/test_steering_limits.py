"""ATC_STR_RAT_MAX from the steering's stops, ATC_TURN_MAX_G from the runs; never lowered unasked."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rover_sweep.gains.gains_json import limits_text
from rover_sweep.gains.proposal import Proposal, SteeringLimits, steering_limits


def limits_of(of: Proposal, largest_us: float | None) -> SteeringLimits:
    found = steering_limits(replace(of, found=replace(of.found, largest_us=largest_us)))
    assert found is not None
    return found


def test_limits_by_hand(proposal: Proposal) -> None:
    assert proposal.steady_gain is not None
    per_us = proposal.steady_gain * 0.00095
    found = limits_of(proposal, 240.0)
    travel = min(proposal.autopilot.us_left, proposal.autopilot.us_right)
    assert found.reach == pytest.approx(57.2958 * per_us * travel, rel=1e-3)
    assert found.rate_max == pytest.approx(0.9 * found.reach, abs=1)
    assert found.turn_g == pytest.approx(per_us * 240 * proposal.speed / 9.80665, abs=0.01)


def test_lower_limit_is_a_comment_and_a_higher_one_is_not(proposal: Proposal) -> None:
    low, high = (limits_of(proposal, us) for us in (100.0, 400.0))
    assert replace(low, now_g=0.6).lowers and not replace(high, now_g=0.1).lowers
    assert "\n# ATC_TURN_MAX_G" in limits_text(replace(low, now_g=0.6), {})
    assert "\nATC_TURN_MAX_G" in limits_text(replace(high, now_g=0.1), {"ATC_TURN_MAX_G": 0.1})


def test_unknown_amplitude_leaves_the_lateral_limit_out(proposal: Proposal) -> None:
    assert "ATC_TURN_MAX_G" not in limits_text(limits_of(proposal, None), {})


def test_no_gains_no_limits(proposal: Proposal) -> None:
    assert steering_limits(replace(proposal, proposed=None)) is None
