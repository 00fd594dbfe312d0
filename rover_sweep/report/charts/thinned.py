"""Fewer points of long lines, such that every peak stays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array


def kept_points(lines: Sequence[Array], most: int) -> NDArray[np.intp]:
    """Indices of at most about `most` points: the smallest and largest of every line in each of equal parts.

    All points if there are at most that many.
    """
    n = lines[0].size
    if n <= most:
        return np.arange(n)
    parts = max(most // (2 * len(lines)), 1)
    size = -(-n // parts)
    padded = np.pad(np.arange(n), (0, -n % size), mode="edge").reshape(-1, size)
    kept = [np.array([0, n - 1])]
    for y in lines:
        block = y[padded]
        kept.append(padded[np.arange(len(padded)), np.where(np.isnan(block), np.inf, block).argmin(axis=1)])
        kept.append(padded[np.arange(len(padded)), np.where(np.isnan(block), -np.inf, block).argmax(axis=1)])
    return np.unique(np.concatenate(kept))
