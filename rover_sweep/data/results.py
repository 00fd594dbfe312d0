"""Parts of results: quantities with intervals, values found by name, short tables."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from html import escape
from typing import Any, Literal, Protocol, TypeVar

import numpy as np

Advice = Literal["keep", "repeat", "discard"]  # what to do with a run
Progress = Callable[[str, float], None]  # told the current step and the share done, 0..1

# Python's own numbers in results: `1.5`, not `np.float64(1.5)`, where a result is printed.


class PlainNumbers:
    """Base of frozen dataclasses: numpy's scalars in their fields become Python's numbers."""

    def __post_init__(self) -> None:
        for f in fields(self):  # type: ignore[arg-type]  # of the dataclass that derives from it
            given = getattr(self, f.name)
            if (own := plain_value(given)) is not given:
                object.__setattr__(self, f.name, own)


def plain_value(value: Any) -> Any:
    """The value with numpy's scalars replaced by Python's numbers, also in tuples and dicts."""
    if isinstance(value, np.generic):
        return value.item()
    if type(value) is tuple:
        own = tuple(plain_value(v) for v in value)
        return own if any(a is not b for a, b in zip(own, value, strict=True)) else value
    if type(value) is dict:
        items = {k: plain_value(v) for k, v in value.items()}
        return items if any(items[k] is not v for k, v in value.items()) else value
    return value


# Results that print as a short table: text at a prompt, HTML in a notebook.


@dataclass(frozen=True)
class ShortTable:
    """A title, headings over rows of texts, notes below. First cells are aligned left, others right."""

    title: str
    headings: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        lines = [self.headings, *self.rows] if self.rows else []
        widths = [max(len(line[k]) for line in lines) for k in range(len(self.headings))] if lines else []
        shown = ["  ".join(_aligned(line, widths)).rstrip() for line in lines]
        return "\n".join([self.title, *(f"  {line}" for line in shown), *self.notes])

    def html(self) -> str:
        """The table as an HTML fragment."""
        head = "".join(f"<th>{escape(h)}</th>" for h in self.headings)
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in self.rows
        )
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>" if self.rows else ""
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        return f"<p><strong>{escape(self.title)}</strong></p>{table}{notes}"


def _aligned(line: tuple[str, ...], widths: list[int]) -> list[str]:
    first, *rest = zip(line, widths, strict=True)
    return [first[0].ljust(first[1]), *(text.rjust(width) for text, width in rest)]


class Shown:
    """Base class of results that print their `table`; dataclasses need repr=False."""

    @abstractmethod
    def table(self) -> ShortTable:
        """The table to print."""

    def __repr__(self) -> str:
        return str(self.table())

    def _repr_html_(self) -> str:
        return self.table().html()


def number(value: float | None, digits: int = 4) -> str:
    """The value with `digits` significant digits; an exponent only below 1e-4 and from 1e6; – for None."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if not -4 <= size <= 5:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(digits - 1 - size, 0)}f}"


def plain_number(value: float | None, digits: int = 4) -> str:
    """A number with `digits` significant digits, "-" for None."""
    return "-" if value is None else f"{value:.{digits}g}"


def band_words(band: tuple[float, float] | None) -> str:
    """A band as "0.3 - 25", or none."""
    return f"{band[0]:.2g} - {band[1]:.3g}" if band else "none"


class _Named(Protocol):
    """Anything with a name."""

    @property
    def name(self) -> str:
        """Its name, unique among its neighbours."""


T = TypeVar("T", bound=_Named)


class ByName(Shown, tuple[T, ...]):
    """A tuple whose items are also found by their names.

    >>> from rover_sweep.data.results import ByName, Quantity
    >>> one, two = (Quantity(name, "s", 0.035, 0.03, 0.04) for name in ("C", "tau"))
    >>> both = ByName((one, two))
    >>> both["tau"].high, both[0].name, "C" in both, both.keys()
    (0.04, 'C', True, ('C', 'tau'))
    """

    __slots__ = ()

    def __getitem__(self, key: Any) -> Any:
        """The item of a name or a position, or the items of a slice; KeyError for an unknown name."""
        if not isinstance(key, str):
            return super().__getitem__(key)
        for item in self:
            if item.name == key:
                return item
        raise KeyError(f"there is no {key!r}; the names are {', '.join(self.keys()) or 'none'}")

    def __contains__(self, key: object) -> bool:
        return key in self.keys() if isinstance(key, str) else super().__contains__(key)

    def keys(self) -> tuple[str, ...]:
        """The names, in order; with them `dict(parameters)` gives {name: item}."""
        return tuple(item.name for item in self)

    def items(self) -> Iterator[tuple[str, T]]:
        """(name, item), in order."""
        return ((item.name, item) for item in self)

    def table(self, title: str = "", notes: tuple[str, ...] = ()) -> ShortTable:
        """A row for each item: value, unit, interval and meaning, as far as it has them."""
        rows = tuple(
            (
                item.name,
                plain_number(getattr(item, "value", None)),
                getattr(item, "unit", ""),
                _interval(item),
                getattr(item, "meaning", ""),
            )
            for item in self
        )
        headings = ("parameter", "value", "unit", "90 % interval", "meaning")
        count = f"{len(self)} parameter{'s' if len(self) != 1 else ''}"
        return ShortTable(title or count, headings, rows, notes)


def _interval(item: Any) -> str:
    """ "low to high" of an item with `interval_90`, or with `low` and `high`; "" without."""
    ends = getattr(item, "interval_90", (getattr(item, "low", None), getattr(item, "high", None)))
    return "" if ends is None or ends == (None, None) else " to ".join(plain_number(x) for x in ends)


# A number with its interval.


LEVEL = 0.90  # coverage
NORMAL_90 = 1.645  # standard deviations to each side of a 90 % interval


@dataclass(frozen=True)
class Quantity(PlainNumbers):
    """A number with its 90 % interval, in `unit`; low or high None where there is no such limit.

    bound: Cramer-Rao bound of the value, where that was computed.
    """

    name: str
    unit: str
    value: float
    low: float | None = None
    high: float | None = None
    meaning: str = ""
    bound: float | None = None

    @property
    def interval_90(self) -> tuple[float, float] | None:
        """(low, high) of the 90 % interval, in `unit`; None where an end is missing."""
        return None if self.low is None or self.high is None else (self.low, self.high)


def ends_words(low: float | None, high: float | None, digits: int = 3) -> str:
    """An interval as every page and terminal shows it, open at an end that was not found."""
    if low is None and high is None:
        return "-"
    if high is None:
        return f"from {number(low, digits)}"
    last = number(high, digits)
    return f"to {last}" if low is None else f"{number(low, digits)} to {last}"
