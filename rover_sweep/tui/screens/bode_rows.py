"""The frequency response of a run just driven: gain, phase and coherence over frequency."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rover_sweep.data.braille import braille_lines
from rover_sweep.live.snapshot import ResponseCurve
from rover_sweep.tui.drawn import labels
from rover_sweep.tui.drawn.drawing import ScreenRows

ENOUGH = 0.6  # coherence from which a point is used in a fit
_LABELS = 13  # columns
_INPUTS = {
    "rad": "rad of wheel angle, left positive, as in the report",
    "us": "us of output (report: per rad, left positive)",
}


def draw_bode(rows: ScreenRows, curve: ResponseCurve) -> None:
    """Three panels over one frequency axis, in the rows that are left."""
    palette = rows.palette
    name = labels.RESPONSES.get(curve.response, curve.response)
    rows.add(f" {name} per {_INPUTS[curve.steering]}, over rad/s", style=f"bold {palette.ink}")
    room = rows.left - 2
    if room < 9 or len(curve.w) < 2:
        rows.add(" too few points, or too small a window, for a picture", style=palette.quiet)
        return
    each = room // 3
    trusted = [k for k, c in enumerate(curve.coherence) if c >= ENOUGH] or range(len(curve.w))
    _panel(rows, "gain dB", curve.w, curve.gain, _range([curve.gain[k] for k in trusted], 5.0), each)
    _panel(rows, "phase deg", curve.w, curve.phase, _range([curve.phase[k] for k in trusted], 90.0), each)
    _panel(rows, "coherence", curve.w, curve.coherence, (0.0, 1.0), room - 2 * each)
    rows.add(" " * _LABELS + decades(curve.w[0], curve.w[-1], _width(rows)), style=palette.quiet)
    good = sum(c >= ENOUGH for c in curve.coherence) / len(curve.w)
    rows.add(f" coherence is at least {ENOUGH:g} at {100 * good:.0f} % of the points", style=palette.ink)


def _width(rows: ScreenRows) -> int:
    return rows.width - _LABELS - 1


def _panel(
    rows: ScreenRows, name: str, w: Sequence[float], y: Sequence[float], ends: tuple[float, float], each: int
) -> None:
    across = [math.log(one) for one in w]
    drawn = braille_lines([(across, y)], (across[0], across[-1]), ends, _width(rows), each)
    for n, line in enumerate(drawn):
        value = f"{ends[1]:.4g}" if n == 0 else f"{ends[0]:.4g}" if n == each - 1 else ""
        word = name if n == each // 2 else ""
        rows.add(
            (f" {word or value:>{_LABELS - 3}} ┤" if value or word else " " * (_LABELS - 1) + "│", ""),
            (line, rows.palette.accent),
            style=rows.palette.ink,
        )


def _range(values: Sequence[float], step: float) -> tuple[float, float]:
    """The ends, multiples of `step`, of an axis that holds the values."""
    finite = [v for v in values if math.isfinite(v)] or [0.0]
    low, high = math.floor(min(finite) / step) * step, math.ceil(max(finite) / step) * step
    return low, (high if high > low else low + step)


def decades(low: float, high: float, width: int) -> str:
    """A row of `width` characters below a logarithmic axis: 1, 2, 5, ... at their places, and the ends."""
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
