"""Further starting points of a fit, which show whether its result depends on the start.

Each draws every free parameter, reproducibly for a structure: positive ones by a factor (log-uniform, 0.1 to
10), bounded ones of either sign uniformly between their bounds, delays uniformly up to three times their
value, unbounded ones of either sign around zero; all within the bounds. `near_starts` stays within 60 % of
the present values, for a structure whose starting values are already good.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.identification.structure.state_space import ModelStructure, Parameter

COUNT = 3
REACH = 10.0  # largest factor between start and value of a positive parameter
NEAR = 0.6  # of the value: reach of `near_starts`
DELAY_REACH = 3.0  # times its value, of a delay: with much more, the phase is off by 360 deg


def drawn_starts(structure: ModelStructure, count: int = COUNT, seed: int = 0) -> list[dict[str, float]]:
    """`count` starting points {free parameter: value}, the same for a seed."""
    rng = np.random.default_rng(seed)
    delays = structure.delays
    return [{p.name: _drawn(p, p.name in delays, rng) for p in structure.free} for _ in range(count)]


def near_starts(structure: ModelStructure, count: int = COUNT, seed: int = 0) -> list[dict[str, float]]:
    """`count` starting points within 60 % of the present values, the same for a seed."""
    rng = np.random.default_rng(seed)
    return [
        {
            p.name: float(np.clip(p.value * (1 + NEAR * rng.uniform(-1, 1)), p.lower, p.upper))
            for p in structure.free
        }
        for _ in range(count)
    ]


def farthest(best: ModelStructure, others: Sequence[ModelStructure]) -> tuple[str, float]:
    """(parameter, relative difference) with the largest difference of the others from the best.

    Relative to the best value, or absolute where that is 0.
    """
    apart = {
        p.name: max(abs(o.values[p.name] - p.value) for o in others) / (abs(p.value) or 1.0)
        for p in best.free
    }
    name = max(apart, key=lambda n: apart[n], default="")
    return name, apart.get(name, 0.0)


def _drawn(p: Parameter, delay: bool, rng: np.random.Generator) -> float:
    share = float(rng.uniform())
    if delay:
        value = share * DELAY_REACH * p.value
    elif p.lower >= 0 and p.value > 0:
        value = p.value * REACH ** (2 * share - 1)
    elif np.isfinite(p.lower) and np.isfinite(p.upper):
        value = p.lower + share * (p.upper - p.lower)
    else:
        value = 3 * (2 * share - 1) * (abs(p.value) or 1.0)
    return float(np.clip(value, p.lower, p.upper))
