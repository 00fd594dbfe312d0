"""The run to add to driven ones: what each choice is expected to tell about the explanations left open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rover_sweep.diagnosis.plans.expected_posterior import NONE, OTHER, expected
from rover_sweep.diagnosis.plans.plan import LEAST_BITS
from rover_sweep.diagnosis.plans.plan_result import PlannedRun
from rover_sweep.diagnosis.plans.planner import Planner
from rover_sweep.diagnosis.posterior.infer import SURE

Odds = Mapping[str, float]
"""{explanation: its probability after the driven runs}, of effects, NONE and OTHER; need not sum to 1."""


@dataclass(frozen=True)
class RunValue:
    """What one more run is expected to tell.

    bits: information on the open explanations. settles: effects that it is expected to make sure, if they are
    the truth.
    """

    run: PlannedRun
    bits: float
    settles: tuple[str, ...] = ()


def effects_of(odds: Odds) -> tuple[str, ...]:
    """The effects among the explanations."""
    return tuple(e for e in odds if e not in (NONE, OTHER))


def run_values(
    planner: Planner, driven: Sequence[PlannedRun], choices: Sequence[PlannedRun], odds: Odds
) -> tuple[RunValue, ...]:
    """The choices that are worth their drive, the best first."""
    possible = {e: p for e, p in odds.items() if e in {NONE, OTHER, *planner.asked} and p > 0.0}
    truths = [e for e in possible if e != OTHER]
    if len(truths) < 2:
        return ()
    odds = {e: p / sum(possible.values()) for e, p in possible.items()}
    planner.simulate(driven, (0.0, 0.2))
    planner.simulate(choices, (0.2, 0.9))
    before, found = expected(planner.together(driven), truths), []
    for run in choices:
        after = expected(planner.together((*driven, run)), truths)
        shares = after.shares(before, odds)
        settles = tuple(e for e in effects_of(odds) if shares[e][e] >= SURE > odds[e])
        found.append(RunValue(run, after.information(before, odds), settles))
    return tuple(sorted((v for v in found if v.bits >= LEAST_BITS), key=lambda v: v.bits, reverse=True))
