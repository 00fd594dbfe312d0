"""Small text plots: blocks for a spectrum, and a ruler below a plot."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array

_BLOCKS = " ▁▂▃▄▅▆▇█"


def blocks(values: Array, low: float, high: float) -> str:
    """One line of bars: values (n,) between `low` (empty) and `high` (full)."""
    share = np.clip((values - low) / (high - low), 0, 1)
    return "".join(_BLOCKS[round(8 * float(s))] for s in share)


def ruler(labels: list[tuple[float, str]], width: int) -> str:
    """A line of `width` characters with each label centred at its position 0..1; skips overlapping labels."""
    line = [" "] * width
    for place, label in labels:
        start = min(max(round(place * (width - 1) - len(label) / 2), 0), width - len(label))
        if all(c == " " for c in line[max(start - 1, 0) : start + len(label) + 1]):
            line[start : start + len(label)] = label
    return "".join(line).rstrip()
