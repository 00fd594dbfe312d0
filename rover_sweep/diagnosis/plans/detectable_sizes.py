"""Detectable sizes: from which a diagnosis of these runs is expected to name an effect."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

from rover_sweep.diagnosis.plans.expected_posterior import expected
from rover_sweep.diagnosis.plans.plan_result import DetectableSize, PlannedRun
from rover_sweep.diagnosis.plans.planner import Planner
from rover_sweep.diagnosis.plans.run_evidence import Assumed
from rover_sweep.diagnosis.posterior.infer import SURE
from rover_sweep.diagnosis.posterior.upper_bounds import reported_value
from rover_sweep.diagnosis.search.material import least_size

PASSES = 8  # bisections, of a range of sizes of 256: to 2 %


def detectable(planner: Planner, runs: Sequence[PlannedRun]) -> dict[str, DetectableSize]:
    """{asked effect: detectable size of its first parameter}, of those that some size shows in these runs.

    By bisection of the size's logarithm, since the signatures of limits grow faster than the size: the runs
    are simulated with each effect at the size that is tried.
    """
    given = planner.assumed
    low = dict.fromkeys(planner.asked, 1.0 / 16.0)
    high = {e: min(16.0, given.reach[e, given.first(e).name].most) for e in planner.asked}
    sure = dict.fromkeys(planner.asked, False)
    for n in range(PASSES):
        planner.progress("computing detectable sizes", 0.85 + 0.15 * n / PASSES)
        tried = {e: sqrt(low[e] * high[e]) for e in planner.asked}
        p = expected(planner.together(runs, tried), planner.asked).sure
        for effect, size in tried.items():
            named = p[effect] >= SURE
            sure[effect] |= named
            (high if named else low)[effect] = size
    return {e: _shown(given, e, high[e]) for e in planner.asked if sure[e]}


def _shown(given: Assumed, effect: str, times: float) -> DetectableSize:
    """The size as a user reads it; times: over the reach."""
    law, p = given.effects[effect], given.first(effect)
    reach, least = given.reach[effect, p.name], least_size(law, p, given.model, given.x)
    way = 1.0 if reach.distance > 0.0 else -1.0
    size = max(way * (reach.start + times * reach.distance) / p.per, least)
    name, unit, value = reported_value(law, p, way * size)
    return DetectableSize(name, unit, value, reported_value(law, p, way * least)[2] if least > 0.0 else None)
