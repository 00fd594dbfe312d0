"""Values in their order that are also found by name, as in the JSON files: `parameters["tau"].value`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol, TypeVar

from rover_sweep.data.result_table import ShortTable, plain_number

HEADINGS = ("parameter", "value", "unit", "90 % interval", "meaning")


class _Named(Protocol):
    """Anything with a name."""

    @property
    def name(self) -> str:
        """Its name, unique among its neighbours."""


T = TypeVar("T", bound=_Named)


class ByName(tuple[T, ...]):
    """A tuple whose items are also found by their names.

    >>> from rover_sweep.data.by_name import ByName
    >>> from rover_sweep.data.intervals import Intervals
    >>> one, two = (Intervals(name, 0.03, 0.04, 0.9, 0.002, 0.0, 200, 0) for name in ("C", "tau"))
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
        return ShortTable(
            title or f"{len(self)} parameter{'s' if len(self) != 1 else ''}", HEADINGS, rows, notes
        )

    def __repr__(self) -> str:
        return str(self.table())

    def _repr_html_(self) -> str:
        return self.table().html()


def _interval(item: Any) -> str:
    """ "low to high" of an item with `interval_90`, or with `low` and `high`; "" without."""
    ends = getattr(item, "interval_90", (getattr(item, "low", None), getattr(item, "high", None)))
    return "" if ends is None or ends == (None, None) else " to ".join(plain_number(x) for x in ends)
