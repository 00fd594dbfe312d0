"""Small text plots: braille dots for a wave, blocks for a spectrum."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array

_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))  # braille bit of (column, row) in a cell
_BLOCKS = " ▁▂▃▄▅▆▇█"


def braille(x: Array, width: int, height: int) -> list[str]:
    """`height` lines of `width` characters of samples x (n,), evenly spaced, between -max|x| and +max|x|.

    Each column of dots spans the least and largest sample that falls in it, so a fast wave shows as a band.
    """
    columns, rows = 2 * width, 4 * height
    peak = float(np.max(np.abs(x))) or 1.0
    level = np.rint((1 - x / peak) / 2 * (rows - 1)).astype(int)
    edges = np.linspace(0, x.size, columns + 1).astype(int)
    cells = np.zeros((height, width), dtype=int)
    for column in range(columns):
        part = level[
            edges[column] : max(edges[column + 1] + 1, edges[column] + 2)
        ]  # joined to the next column
        for row in range(part.min(), part.max() + 1):
            cells[row // 4, column // 2] |= _DOTS[column % 2][row % 4]
    return ["".join(chr(0x2800 + cell) for cell in line) for line in cells]


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
