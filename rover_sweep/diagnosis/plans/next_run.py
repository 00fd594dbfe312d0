"""The run to add to driven ones: what each choice is expected to tell about the explanations left open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.diagnosis.plans.expected_posterior import NONE, OTHER, RunSet, expected
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
    """The choices that are worth their drive, the best first.

    Each effect is taken at the size at which the driven runs are expected to leave it as probable as it is.
    """
    truths = [e for e, p in odds.items() if e in {NONE, *planner.asked} and p > 0.0]
    if len(truths) < 2:
        return ()
    planner.simulate(driven, (0.0, 0.2))
    planner.simulate(choices, (0.2, 0.9))
    now = planner.together(driven)
    amounts = [_amount(now, e, odds[e]) for e in truths]
    before, found = expected(now, truths, amounts), []
    share = sum(odds[e] for e in truths) / sum(odds.values())
    for run in choices:
        after = expected(planner.together((*driven, run)), truths, amounts)
        settles = tuple(e for e in effects_of(after.sure) if after.sure[e] >= SURE > before.sure[e])
        bits = share * (after.information(odds) - before.information(odds))
        found.append(RunValue(run, bits, settles))
    return tuple(sorted((v for v in found if v.bits >= LEAST_BITS), key=lambda v: v.bits, reverse=True))


def _amount(runs: RunSet, effect: str, probability: float) -> float:
    """The least amount of an effect, over its reach, with this expected probability, or the largest one."""
    if effect == NONE:
        return 0.0
    tried = np.geomspace(1.0 / 16.0, 4.0, 13)
    found = expected(runs, [effect] * tried.size, tried.tolist())
    p = np.array([share[effect] for share in found.shares])
    return float(tried[np.argmax(p >= min(probability, np.max(p)))])
