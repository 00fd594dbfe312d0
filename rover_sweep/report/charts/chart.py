"""A chart as a value: stacks of panels over a common x axis, in the units that are shown."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array

XAxis = Literal["linear", "log", "date", "words"]


@dataclass(frozen=True, eq=False)
class Curve:
    """y (n,) over the panel's x, NaN for a gap. dash: px; step: a staircase; dots: markers without a line;
    bars: from 0 to y."""

    label: str
    y: Array
    colour: str
    dash: tuple[float, ...] = ()
    width: float = 1.4
    step: bool = False
    dots: bool = False
    bars: bool = False


@dataclass(frozen=True, eq=False)
class Spread:
    """An area between low and high (n,), such as an interval."""

    label: str
    low: Array
    high: Array
    colour: str = "#BBBBBB"


@dataclass(frozen=True, eq=False)
class Panel:
    """Lines over x (n,), increasing.

    limits: of y, None for all data; levels: horizontal lines; height [px]."""

    label: str
    x: Array
    lines: tuple[Curve, ...]
    spreads: tuple[Spread, ...] = ()
    limits: tuple[float, float] | None = None
    levels: tuple[float, ...] = ()
    height: int = 120


@dataclass(frozen=True, eq=False)
class Stack:
    """Panels below each other over one x axis from span[0] to span[1]. For dates x is s since 1970 (UTC),
    for words the index of one of `labels`.

    shades: (from, to, colour); marks: (x, colour) of vertical lines.
    """

    title: str
    x_label: str
    panels: tuple[Panel, ...]
    span: tuple[float, float]
    kind: XAxis = "linear"
    shades: tuple[tuple[float, float, str], ...] = ()
    marks: tuple[tuple[float, str], ...] = ()
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Chart:
    """Stacks in rows of `columns`. width: px of the static picture."""

    stacks: tuple[Stack, ...]
    columns: int = 1
    width: int = 1000


@dataclass(frozen=True, eq=False)
class ChartPlan:
    """A chart of a report, made when needed. name: of its file, unique in the report; interactive: with
    the data that the page's script draws."""

    name: str
    caption: str
    make: Callable[[], Chart]
    interactive: bool = True


# Colours, dashes and plain labels of the charts: Okabe and Ito's palette, distinct in print too.


DATA, SHADE, OUTSIDE, MARK, QUIET = "#222222", "#FBE9C6", "#ECECEC", "#E69F00", "#BFE0F5"
BEFORE: dict[str, Any] = {"colour": "#0072B2", "dash": (6, 2)}
AFTER: dict[str, Any] = {"colour": "#D55E00"}
MODELS: dict[str, dict[str, Any]] = {
    "kinematic": {"colour": "#CC79A7", "dash": (2, 2), "width": 2.2},
    "bicycle": {"colour": "#0072B2", "dash": (7, 3)},
    "roll-yaw": {"colour": "#D55E00"},
    "lumped": {"colour": "#009E73", "dash": (7, 2, 2, 2)},
}
OWN = ("#56B4E9", "#8C510A", "#777777")  # for a user's own structures, in turn
CHANNEL_WORDS = {
    "pwm": "steering output, µs",
    "delta": "road-wheel angle, deg",
    "r": "yaw rate r, deg/s",
    "ay": "lateral acc. a_y, m/s²",
    "p": "roll rate p, deg/s",
    "speed": "speed V, m/s",
    "vy": "V_y, m/s",
    "vydot": "vydot, m/s²",
    "phi": "roll angle, deg",
    "psi": "heading, deg",
    "throttle": "throttle output, µs",
    "servo": "servo position, µs",
}
DEGREES = ("delta", "r", "p", "phi", "psi")  # channels that are shown in degrees


def model_colours(name: str, names: Collection[str]) -> dict[str, Any]:
    """Colour and dash of a model; a user's own structure gets one by its position in `names`."""
    if name in MODELS:
        return MODELS[name]
    place = [n for n in names if n not in MODELS].index(name)
    return {"colour": OWN[place % len(OWN)], "dash": (4, 2, 1, 2)}


def shown_limits(panel: Panel) -> tuple[float, float]:
    """The limits of y: those given, else all data with a margin."""
    if panel.limits:
        return panel.limits
    values = [item.y for item in panel.lines] + [y for s in panel.spreads for y in (s.low, s.high)]
    known = np.concatenate([v[np.isfinite(v)] for v in values]) if values else np.zeros(0)
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    spare = 0.08 * (high - low) or 0.5
    return low - spare, high + spare


# Fewer points of long lines, such that every peak stays.


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


# Places of ticks and their labels.


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
