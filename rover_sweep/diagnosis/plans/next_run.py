"""The run to add to driven ones: what each choice is expected to tell about the explanations left open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rover_sweep.diagnosis.plans.expected_posterior import NONE, OTHER, expected, spreads
from rover_sweep.diagnosis.plans.plan import LEAST_BITS
from rover_sweep.diagnosis.plans.plan_result import PlannedRun
from rover_sweep.diagnosis.plans.planner import Planner
from rover_sweep.diagnosis.posterior.infer import SURE


@dataclass(frozen=True)
class OpenPoints:
    """What runs have not decided.

    odds: {explanation: its probability after the runs}, of effects, NONE and OTHER; need not sum to 1.
    bounds: {effect: its upper bound over the size that matters}, each above 1.
    """

    odds: Mapping[str, float] = field(default_factory=dict)
    bounds: Mapping[str, float] = field(default_factory=dict)

    @property
    def effects(self) -> tuple[str, ...]:
        """All effects that are named."""
        return tuple(dict.fromkeys(e for e in (*self.odds, *self.bounds) if e not in (NONE, OTHER)))


@dataclass(frozen=True)
class RunValue:
    """What one more run is expected to tell.

    bits: information on the open explanations. settles: effects that it is expected to make sure, if they are
    the truth. lowers: effects whose bound it brings below the size that matters.
    """

    run: PlannedRun
    bits: float
    settles: tuple[str, ...] = ()
    lowers: tuple[str, ...] = ()


def run_values(
    planner: Planner, driven: Sequence[PlannedRun], choices: Sequence[PlannedRun], points: OpenPoints
) -> tuple[RunValue, ...]:
    """The choices that tell something about the open points, the best first."""
    known = {NONE, *planner.asked}
    open_now = {e: p for e, p in points.odds.items() if e in {*known, OTHER} and p > 0.0}
    odds = {e: p / sum(open_now.values()) for e, p in open_now.items()} or {NONE: 1.0}
    truths = [e for e in odds if e != OTHER]
    bounds = {e: times for e, times in points.bounds.items() if e in known}
    if len(truths) < 2 and not bounds:
        return ()
    planner.simulate(driven, (0.0, 0.2))
    planner.simulate(choices, (0.2, 0.9))
    before = planner.together(driven)
    told, was = expected(before, truths), spreads(before)
    found = []
    for run in choices:
        after = planner.together((*driven, run))
        more, now = expected(after, truths), spreads(after)
        shares = more.shares(told, odds)
        settles = tuple(e for e in truths if e != NONE and shares[e][e] >= SURE > odds[e])
        lowers = tuple(e for e, times in bounds.items() if times * now[e] <= was[e])
        found.append(RunValue(run, more.information(told, odds), settles, lowers))
    worth = [v for v in found if v.bits >= LEAST_BITS or v.lowers]
    return tuple(sorted(worth, key=lambda v: (len(v.lowers), v.bits), reverse=True))
