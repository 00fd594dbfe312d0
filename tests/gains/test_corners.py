"""The path round a 90 degree corner with a rover's gains and limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rover_sweep.gains.corner import CORNER, corner_path, corners
from rover_sweep.gains.proposal import Proposal, family_of, steering_limits
from rover_sweep.report.gains_report import gains_report
from rover_sweep.report.on_terminal import on_terminal

SPEED = 2.5


def path(proposal: Proposal, rate_max: float, gains=None):
    loop = replace(proposal.autopilot, rate_max=math.radians(rate_max))
    family = family_of(replace(proposal.found, intervals={}), loop, SPEED)
    return corner_path(loop, family.nominal, family.angle_per_output[0], gains or proposal.proposed.gains)


def test_the_path_is_a_circle_between_two_straight_lines(proposal: Proposal):
    rate, ahead, aside = path(proposal, 40.0)
    assert math.degrees(rate) == pytest.approx(40.0, rel=0.08)
    along, across = np.gradient(ahead), np.gradient(aside)
    heading = np.unwrap(np.arctan2(across, along))
    assert heading[-1] == pytest.approx(CORNER, abs=0.01)
    middle = (heading > 0.5) & (heading < 1.0)
    curvature = np.gradient(heading)[middle] / np.hypot(along, across)[middle]
    assert 1 / np.median(curvature) == pytest.approx(SPEED / math.radians(40.0), rel=0.05)
    assert ahead[-1] > SPEED / math.radians(40.0), "the limits of the acceleration make it longer"


def test_a_lower_limit_needs_more_room(proposal: Proposal):
    """ATC_STR_RAT_MAX, as in ardupilot #32917."""
    room = [path(proposal, rate)[1][-1] for rate in (30.0, 45.0, 90.0)]
    assert room[0] > room[1] > room[2]
    assert room[0] - room[2] > 1.0


def test_the_corridor_is_left_where_the_path_is_off_the_legs(proposal: Proposal):
    limits = steering_limits(proposal)
    found = corners(proposal, limits)
    assert [(round(c.speed, 2), c.gains) for c in found[::2]] == [(1.67, "now"), (2.5, "now"), (3.75, "now")]
    proposed = next(c for c in found if c.gains == "proposed" and c.speed == SPEED)
    for width, inside in ((1.05 * proposed.off, True), (0.8 * proposed.off, False)):
        (again,) = (c for c in corners(proposal, limits, width) if c.gains == "proposed" and c.speed == SPEED)
        assert (again.leaves is None) == inside
    assert again.leaves is not None and again.returns is not None
    assert -proposed.before < again.leaves < 0 < again.returns and not again.wide


def test_gains_that_turn_too_late_swing_wide(proposal: Proposal):
    """The firmware's defaults hold a third of the turn rate until the integrator has grown."""
    now = next(c for c in corners(proposal, None) if c.gains == "now" and c.speed == SPEED)
    assert now.wide and now.leaves is not None and now.leaves > 0
    assert now.off > 1.5


def test_the_table_is_in_the_answer(proposal: Proposal):
    from rich.console import Console

    limits = steering_limits(proposal)
    console = Console(width=140)
    with console.capture() as capture:
        console.print(on_terminal(gains_report(proposal, limits, corners(proposal, limits))))
    said = capture.get()
    assert "A corner of 90 degrees" in said and "corridor of +-1 m" in said
    assert "swings wide from" in said and "stays in it" in said
