"""Numbers as characters: bar, pointer between limits, short history, number or dash."""

from __future__ import annotations

import math
from collections.abc import Sequence

_STEPS = " ▁▂▃▄▅▆▇█"


def bar(share: float, width: int) -> str:
    """`share` 0..1 of `width` cells; an empty bar for NaN."""
    full = round(min(1.0, max(0.0, share)) * width) if math.isfinite(share) else 0
    return "█" * full + "░" * (width - full)


def pointer(value: float, low: float, high: float, width: int) -> str:
    """Position of `value` between two limits, with the middle marked; an arrow at the edge if outside."""
    cells = list("[" + "·" * (width - 2) + "]")
    cells[width // 2] = "|"
    if math.isfinite(value) and high > low:
        share = (value - low) / (high - low)
        if share < 0:
            cells[0] = "◀"
        elif share > 1:
            cells[-1] = "▶"
        else:
            cells[1 + round(share * (width - 3))] = "█"
    return "".join(cells)


def column_chart(values: Sequence[float], low: float, high: float, width: int, rows: int = 1) -> list[str]:
    """The last `width` values between two limits as columns, the newest at the right; blank for NaN.

    Returns `rows` rows, the uppermost first.
    """
    heights = [_height(value, low, high, rows) for value in values[-width:]]
    return [
        "".join(_STEPS[min(8, max(0, height - 8 * row))] for height in heights).rjust(width)
        for row in reversed(range(rows))
    ]


def _height(value: float, low: float, high: float, rows: int) -> int:
    """Height of a column in eighths of a row: at least one, 0 for NaN."""
    if not math.isfinite(value):
        return 0
    share = min(1.0, max(0.0, (value - low) / (high - low)))
    return max(1, round(share * 8 * rows))


def fixed_width(value: float, form: str) -> str:
    """The number, or a dash of the same width for NaN."""
    text = format(value if math.isfinite(value) else 0.0, form)
    if not math.isfinite(value):
        return "-".rjust(len(text))
    return text if float(text) else format(0.0, form)  # no -0
