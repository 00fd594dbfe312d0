"""A chart as a value: stacks of panels over a common x axis, in the units that are shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from rover_sweep.data.recording import Array

XAxis = Literal["linear", "log", "date"]


@dataclass(frozen=True, eq=False)
class Curve:
    """y (n,) over the panel's x, NaN for a gap. dash: px; step: a staircase; dots: markers without a line."""

    label: str
    y: Array
    colour: str
    dash: tuple[float, ...] = ()
    width: float = 1.4
    step: bool = False
    dots: bool = False


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
    """Panels below each other over one x axis from span[0] to span[1]. For dates x is s since 1970 (UTC).

    shades: (from, to, colour); marks: (x, colour) of vertical lines.
    """

    title: str
    x_label: str
    panels: tuple[Panel, ...]
    span: tuple[float, float]
    kind: XAxis = "linear"
    shades: tuple[tuple[float, float, str], ...] = ()
    marks: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Chart:
    """Stacks in rows of `columns`."""

    stacks: tuple[Stack, ...]
    columns: int = 1


@dataclass(frozen=True, eq=False)
class ChartPlan:
    """A chart of a report, made when needed. name: of its file; section: of its page."""

    name: str
    section: str
    caption: str
    make: Callable[[], Chart]
