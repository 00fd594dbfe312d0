"""Interval of a parameter, as the bootstrap finds it."""

from __future__ import annotations

from dataclasses import dataclass

LEVEL = 0.90


@dataclass(frozen=True)
class Intervals:
    """Interval of one parameter at `level`, and the standard deviation of its estimate, in its unit.

    bias: how far the method itself puts the estimate from the truth; the interval has it taken out, so
    it need not hold the estimate. replicates: how many it rests on; failed: how many ran off. low, high,
    sd and bias are nan where fewer than half of them settled.
    """

    name: str
    low: float
    high: float
    level: float
    sd: float
    bias: float
    replicates: int
    failed: int
