"""Confidence interval of a parameter, from the bootstrap and from errors of a tyre model's structure."""

from __future__ import annotations

from dataclasses import dataclass

from rover_sweep.data.plain_values import PlainNumbers

LEVEL = 0.90  # coverage


@dataclass(frozen=True)
class Intervals(PlainNumbers):
    """Interval low..high of one parameter at `level` (0..1), in its unit; sd: of the estimate.

    bias: of the method; the interval of the noise is corrected for it, then widened to hold the estimate.
    sd and bias are those of the noise, also where low and high include errors of the structure. replicates:
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
