"""Which channel is wrong, of relations that are made up: two against one decide, one against one do not."""

from __future__ import annotations

from math import exp

import pytest

from rover_sweep.quality.redundant import DECIDED, ChannelFault, ChannelRelation, explanations

SPEED = ChannelFault("speed", "speed", 0.03, scaled=("speed",))
RECEIVER = ChannelFault("receiver", "gps", 0.01, scaled=("gps",))
ACCELERATION = ChannelFault("acceleration", "ay", 0.01, scaled=("ay",))
BACKWARDS = ChannelFault("backwards", "heading", 0.03, turned=("heading",))
THROTTLE = ChannelFault("throttle", "throttle", 0.02, turned=("throttle",))
UPSIDE_DOWN = ChannelFault("upside down", "r", 0.02, turned=("r", "ay"))
ALL = (SPEED, RECEIVER, ACCELERATION, BACKWARDS, THROTTLE, UPSIDE_DOWN)


def by_gps(ratio: float) -> ChannelRelation:
    return ChannelRelation("gps", {"speed": 1, "gps": -1}, ratio, 0.02)


def by_force(ratio: float, sign: int = 1) -> ChannelRelation:
    signs = ("ay", "r", "heading")
    return ChannelRelation("force", {"ay": 1, "speed": -1, "r": -1}, ratio, 0.08, signs, sign)


def by_throttle(sign: int) -> ChannelRelation:
    return ChannelRelation("throttle", {}, 1.0, 1.0, ("throttle", "heading"), sign)


def by_heading(sign: int) -> ChannelRelation:
    return ChannelRelation("psi", {"psi": 1, "r": -1}, 1.0, 0.03, ("psi", "r"), sign)


def test_probabilities_add_up_to_one() -> None:
    found = explanations([by_gps(1.3), by_force(0.8)], ALL)
    assert sum(one.probability for one in found) == pytest.approx(1.0)


@pytest.mark.parametrize("factor", [0.7, 1.3, 4.0])
def test_two_against_one_decide_and_give_the_factor(factor: float) -> None:
    best = explanations([by_gps(factor), by_force(1 / factor)], ALL)[0]
    assert best.faults == (SPEED,) and best.probability > DECIDED
    value, sd = best.scales["speed"]
    assert value == pytest.approx(factor, rel=0.01)
    assert sd == pytest.approx((0.02**-2 + 0.08**-2 + 1) ** -0.5, rel=0.01), "both relations count"


def test_the_one_that_two_contradict_is_the_other_where_they_agree_otherwise() -> None:
    """GPS off, but the estimator's speed agrees with a_y."""
    best = explanations([by_gps(0.5), by_force(1.0)], ALL)[0]
    assert best.faults == (RECEIVER,) and best.scales["gps"][0] == pytest.approx(2.0, rel=0.01)


def test_one_against_one_is_not_decided() -> None:
    first, second = explanations([by_force(0.25)], ALL)[:2]
    assert first.probability < DECIDED
    assert {first.faults, second.faults} == {(SPEED,), (ACCELERATION,)}


@pytest.mark.parametrize(("gps", "force"), [(1.0, 1.0), (0.97, 1.1), (1.04, 0.87)])
def test_small_differences_are_nobodys_fault(gps: float, force: float) -> None:
    best = explanations([by_gps(gps), by_force(force), by_throttle(1), by_heading(1)], ALL)[0]
    assert not best.faults and best.probability > 0.5


def test_signs_decide_in_twos_too() -> None:
    best = explanations([by_force(1.0, -1), by_throttle(-1)], ALL)[0]
    assert best.faults == (BACKWARDS,) and best.probability > DECIDED and best.turned == {"heading"}
    best = explanations([by_force(1.0), by_throttle(1), by_heading(-1)], ALL)[0]
    assert best.faults == (UPSIDE_DOWN,), "a_y r keeps its sign, against the heading r has not"
    best = explanations([by_force(1.0, -1)], ALL)[0]
    assert best.probability < DECIDED, "heading against acceleration"


def test_faults_that_look_alike_are_one() -> None:
    """Two names of the same effect would halve each other's probability."""
    again = ChannelFault("wheel radius", "speed", 0.02, scaled=("speed", "wheels"))
    best = explanations([by_gps(1.3), by_force(1 / 1.3)], (*ALL, again))[0]
    assert best.faults == (SPEED,) and best.probability > DECIDED
    wheels = ChannelRelation("wheels", {"speed": 1, "wheels": -1}, 1.0, 0.02)
    best = explanations([by_gps(1.3), by_force(1 / 1.3), wheels], (*ALL, again))[0]
    assert best.faults == (again,) and best.scales["wheels"][0] == pytest.approx(1.3, rel=0.01)


def test_a_free_factor_pays_for_itself() -> None:
    """At three standard deviations of the ratio the fault, which is rare, is about as likely as chance."""
    at = [explanations([by_gps(exp(k * 0.02))], (SPEED,))[0].faults for k in (1, 2, 5)]
    assert at == [(), (), (SPEED,)]
