"""The run to add to driven ones: how much each choice would separate given effects and lower given bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import log

from rover_sweep.diagnosis.plans.plan_result import PlannedRun
from rover_sweep.diagnosis.plans.set_result import Stacked
from rover_sweep.diagnosis.plans.sets import Planner

Pair = tuple[str, str]
CLEARER = 1.5  # a pair that counts as separated before the run must become so much clearer
LEAST_GAIN = 0.1  # sum of logarithms, below which a run tells nothing new


@dataclass(frozen=True)
class OpenPoints:
    """What runs have not decided. pairs: effects that look alike in them, both ids of the plan's effects.

    bounds: {effect: its upper bound over the size that matters}, each above 1. weak: effects that should show
    more clearly.
    """

    pairs: tuple[Pair, ...] = ()
    bounds: Mapping[str, float] = field(default_factory=dict)
    weak: tuple[str, ...] = ()

    @property
    def effects(self) -> tuple[str, ...]:
        """All effects that are named."""
        return tuple(dict.fromkeys([*(e for pair in self.pairs for e in pair), *self.bounds, *self.weak]))


@dataclass(frozen=True)
class RunValue:
    """What one more run is expected to tell.

    separates: open pairs that it separates. lowers: effects whose bound it brings below the size that
    matters. gain: sum of the logarithms of all improvements.
    """

    run: PlannedRun
    separates: tuple[Pair, ...]
    lowers: tuple[str, ...]
    gain: float

    @property
    def rank(self) -> tuple[int, float]:
        """Sorts by the number of settled points, then by the gain."""
        return len(self.separates) + len(self.lowers), self.gain


def run_values(
    planner: Planner, driven: Sequence[PlannedRun], choices: Sequence[PlannedRun], points: OpenPoints
) -> tuple[RunValue, ...]:
    """The choices that tell something about the open points, the best first."""
    known = set(planner.asked)
    pairs = tuple(pair for pair in points.pairs if set(pair) <= known)
    bounds = {effect: times for effect, times in points.bounds.items() if effect in known}
    weak = tuple(effect for effect in points.weak if effect in known)
    if not (pairs or bounds or weak):
        return ()
    points = OpenPoints(pairs, bounds, weak)
    planner.simulate(driven, (0.0, 0.2))
    planner.simulate(choices, (0.2, 0.9))
    before = planner.stacked(driven)
    found = [_value(planner, driven, run, before, points) for run in choices]
    return tuple(sorted((v for v in found if v.gain > LEAST_GAIN), key=lambda v: v.rank, reverse=True))


def _value(
    planner: Planner, driven: Sequence[PlannedRun], run: PlannedRun, before: Stacked, points: OpenPoints
) -> RunValue:
    after = planner.stacked((*driven, run))
    separates, lowers, gain = [], [], 0.0
    for pair in points.pairs:
        was, now = _clear(before, pair, before), _clear(after, pair, before)
        gain += max(log(max(now, 0.01) / max(was, 0.01)), 0.0)
        if now >= max(1.0, CLEARER * was):
            separates.append(pair)
    for effect, times in points.bounds.items():
        expected = times / max(_shrinks(before, after, effect), 1.0)
        gain += log(times / max(expected, 1.0))
        if expected <= 1.0:
            lowers.append(effect)
    gain += sum(log(max(_shrinks(before, after, effect), 1.0)) for effect in points.weak)
    return RunValue(run, tuple(separates), tuple(lowers), gain)


def _clear(part: Stacked, pair: Pair, of: Stacked) -> float:
    """How clearly the runs of `part` separate a pair at the sizes that `of` detects; 0 where it detects
    neither."""
    sizes = {**part.sizes, **of.sizes}
    if any(effect not in sizes for effect in pair):
        return 0.0
    one, two = pair
    return min(part.separation(one, two, sizes), part.separation(two, one, sizes))


def _shrinks(before: Stacked, after: Stacked, effect: str) -> float:
    """The detectable size without the run over that with it; large where it was not detectable at all."""
    now = after.sizes.get(effect)
    if not now:
        return 1.0
    was = before.sizes.get(effect, {})
    ratios = [was[name].coordinate / size.coordinate for name, size in now.items() if name in was]
    return max(ratios, default=10.0)
