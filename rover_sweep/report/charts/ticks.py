"""Places of ticks and their labels."""

from __future__ import annotations

import math
from datetime import UTC, datetime

from rover_sweep.report.charts.chart import XAxis


def ticks(low: float, high: float, kind: XAxis = "linear", most: int = 8) -> list[tuple[float, str]]:
    """(value, label) of round values from low to high."""
    if kind == "log":
        places = [m * 10.0**e for e in range(-4, 5) for m in (1, 2, 5)]
        return [(x, f"{x:g}") for x in places if low <= x <= high]
    if kind == "date":
        day = 86400.0
        step = day * max(1, math.ceil((high - low) / day / min(most, 5)))
        first = math.ceil(low / day) * day
        count = int((high - first) // step) + 1
        return [
            (x, f"{datetime.fromtimestamp(x, UTC):%d %b}") for x in (first + k * step for k in range(count))
        ]
    step = _step((high - low) / most)
    first = math.ceil(low / step - 1e-9)
    return [(k * step, f"{k * step + 0.0:.6g}") for k in range(first, math.floor(high / step + 1e-9) + 1)]


def _step(least: float) -> float:
    """The next of 1, 2 or 5 times a power of ten."""
    if not least > 0:
        return 1.0
    size = 10.0 ** math.floor(math.log10(least))
    return next(m * size for m in (1, 2, 5, 10) if m * size >= least * (1 - 1e-9))
