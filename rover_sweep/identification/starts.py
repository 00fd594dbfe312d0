"""Starting values for a fit beside the given ones, so that an answer that hangs on the start shows.

Each is a draw of every free parameter, the same for the same structure: positive ones by a factor
(log-uniform, a tenth to ten times), bounded ones of either sign uniformly between their bounds, delays
uniformly up to three times their value, unbounded ones of either sign around nought; all within the bounds.
A structure whose starts are known to be near, such as derivatives of another model, is tried around them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.identification.structure.state_space import ModelStructure, Parameter

COUNT = 3
REACH = 10.0  # factor by which a positive parameter may start off
NEAR = 0.6  # of its value, for a parameter tried around it
LATER = 3.0  # times its value, for a delay: with far more, the phase is a whole turn off


def drawn_starts(structure: ModelStructure, count: int = COUNT, seed: int = 0) -> list[dict[str, float]]:
    """`count` starting points {free parameter: value}, always the same ones for a seed."""
    rng = np.random.default_rng(seed)
    delays = structure.delays
    return [{p.name: _drawn(p, p.name in delays, rng) for p in structure.free} for _ in range(count)]


def near_starts(structure: ModelStructure, count: int = COUNT, seed: int = 0) -> list[dict[str, float]]:
    """`count` starting points within 60 % of the present values, always the same ones for a seed."""
    rng = np.random.default_rng(seed)
    return [
        {
            p.name: float(np.clip(p.value * (1 + NEAR * rng.uniform(-1, 1)), p.lower, p.upper))
            for p in structure.free
        }
        for _ in range(count)
    ]


def farthest(best: ModelStructure, others: Sequence[ModelStructure]) -> tuple[str, float]:
    """(parameter, relative difference) where the others are farthest from the best; 0 counts as 1."""
    apart = {
        p.name: max(abs(o.values[p.name] - p.value) for o in others) / (abs(p.value) or 1.0)
        for p in best.free
    }
    name = max(apart, key=lambda n: apart[n], default="")
    return name, apart.get(name, 0.0)


def _drawn(p: Parameter, delay: bool, rng: np.random.Generator) -> float:
    share = float(rng.uniform())
    if delay:
        value = share * LATER * p.value
    elif p.lower >= 0 and p.value > 0:
        value = p.value * REACH ** (2 * share - 1)
    elif np.isfinite(p.lower) and np.isfinite(p.upper):
        value = p.lower + share * (p.upper - p.lower)
    else:
        value = 3 * (2 * share - 1) * (abs(p.value) or 1.0)
    return float(np.clip(value, p.lower, p.upper))
