"""Confidence interval of a parameter, from the bootstrap."""

from __future__ import annotations

from dataclasses import dataclass

LEVEL = 0.90  # coverage


@dataclass(frozen=True)
class Intervals:
    """Interval low..high of one parameter at `level` (0..1), in its unit; sd: of the estimate.

    bias: of the method; the interval is corrected for it, so it need not contain the estimate. replicates:
    number that converged; failed: number that did not. low, high, sd and bias are nan when more than half
    failed.
    """

    name: str
    low: float
    high: float
    level: float
    sd: float
    bias: float
    replicates: int
    failed: int
