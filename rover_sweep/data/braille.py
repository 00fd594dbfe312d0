"""Lines in braille dots for a terminal, two columns and four rows of dots to a character, and their ruler."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rover_sweep.data.recording import Array

_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))  # by column and row within a character
_BLANK = chr(0x2800)
BARS = " ▁▂▃▄▅▆▇█"  # of rising height, in eighths
Range = tuple[float, float]
Point = tuple[float, float]


def braille_lines(
    lines: Sequence[tuple[Sequence[float] | Array, Sequence[float] | Array]],
    across: Range,
    up: Range,
    width: int,
    rows: int,
) -> list[str]:
    """`rows` strings of `width` characters, the uppermost first: each y over x, joined point by point.

    across, up: ranges of x and y; points outside and points that are not finite are left out.
    """
    cells = [[0] * width for _ in range(rows)]
    if width > 0 and across[1] > across[0] and up[1] > up[0]:
        for x, y in lines:
            right = (np.asarray(x, float) - across[0]) / (across[1] - across[0]) * (2 * width - 1)
            down = (up[1] - np.asarray(y, float)) / (up[1] - up[0]) * (4 * rows - 1)
            points = list(zip(right.tolist(), down.tolist(), strict=True))
            for begin, end in zip(points, points[1:], strict=False):
                _line(cells, begin, end)
    return ["".join(chr(0x2800 + cell) for cell in row).replace(_BLANK, " ") for row in cells]


def _line(cells: list[list[int]], start: Point, end: Point) -> None:
    if not all(map(math.isfinite, (*start, *end))):
        return
    steps = min(500, max(1, math.ceil(max(abs(end[0] - start[0]), abs(end[1] - start[1])))))
    for k in range(steps + 1):
        column = round(start[0] + (end[0] - start[0]) * k / steps)
        row = round(start[1] + (end[1] - start[1]) * k / steps)
        if 0 <= column < 2 * len(cells[0]) and 0 <= row < 4 * len(cells):
            cells[row // 4][column // 2] |= _DOTS[column % 2][row % 4]


def ruler(labels: list[tuple[float, str]], width: int) -> str:
    """A line of `width` characters with each label centred at its position 0..1; skips overlapping labels."""
    line = [" "] * width
    for place, label in labels:
        start = min(max(round(place * (width - 1) - len(label) / 2), 0), width - len(label))
        if all(c == " " for c in line[max(start - 1, 0) : start + len(label) + 1]):
            line[start : start + len(label)] = label
    return "".join(line).rstrip()
