"""Curves over a logarithmic axis, in braille dots: two columns and four rows of dots to a cell."""

from __future__ import annotations

import math
from collections.abc import Sequence

_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))  # by column and row within a cell


def braille_curve(
    x: Sequence[float], y: Sequence[float], low: float, high: float, width: int, rows: int
) -> list[str]:
    """`rows` strings of `width` cells, the uppermost first: y over log x, joined by lines.

    low, high: range of y; what is outside is left out. x rises, above 0; fewer than two points: blank.
    """
    cells = [[0] * width for _ in range(rows)]
    if len(x) >= 2 and high > low and width > 0:
        span = math.log(x[-1] / x[0])
        across = [math.log(one / x[0]) / span * (2 * width - 1) for one in x]
        down = [(high - one) / (high - low) * (4 * rows - 1) for one in y]
        for begin, end in zip(range(len(x)), range(1, len(x)), strict=False):
            _line(cells, (across[begin], down[begin]), (across[end], down[end]))
    return ["".join(chr(0x2800 + cell) if cell else " " for cell in row) for row in cells]


def _line(cells: list[list[int]], start: tuple[float, float], end: tuple[float, float]) -> None:
    if not all(map(math.isfinite, (*start, *end))):
        return
    steps = min(500, max(1, math.ceil(max(abs(end[0] - start[0]), abs(end[1] - start[1])))))
    for k in range(steps + 1):
        column = round(start[0] + (end[0] - start[0]) * k / steps)
        row = round(start[1] + (end[1] - start[1]) * k / steps)
        if 0 <= column < 2 * len(cells[0]) and 0 <= row < 4 * len(cells):
            cells[row // 4][column // 2] |= _DOTS[column % 2][row % 4]


def decades(low: float, high: float, width: int) -> str:
    """A row of `width` cells below such a curve: 1, 2, 5, 10, ... at their places, the ends always."""
    row = [" "] * width
    span = math.log(high / low)
    first, last = f"{low:.2g}", f"{high:.2g}"
    for place, text in ((0, first), (width - len(last), last)):
        row[place : place + len(text)] = text
    for exponent in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1):
        for digit in (1, 2, 5):
            value = digit * 10.0**exponent
            text = f"{value:g}"
            at = round(math.log(value / low) / span * (width - 1))
            around = row[max(0, at - 1) : at + len(text) + 1]
            if low < value < high and at + len(text) < width and all(cell == " " for cell in around):
                row[at : at + len(text)] = text
    return "".join(row)
