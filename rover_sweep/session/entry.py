"""Checked reading of session.json, which may be truncated or edited by hand."""

from __future__ import annotations

import reprlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Kind:
    """The required kind of a value. words: completes "it is 3, not ..."."""

    words: str
    holds: Callable[[Any], bool]


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and value not in ("", ".", "..") and not set(value) & set("/\\\0")


OBJECT = Kind("an object", lambda x: isinstance(x, dict))
LIST = Kind("a list", lambda x: isinstance(x, list))
TEXT = Kind("a text", lambda x: isinstance(x, str))
NAME = Kind("a name without a folder", _is_name)
WHOLE = Kind("a whole number", lambda x: type(x) is int and abs(x) < 2**64)
FLAG = Kind("true or false", lambda x: isinstance(x, bool))
NUMBER = Kind(
    "a finite number",
    lambda x: type(x) in (int, float) and abs(x) <= sys.float_info.max,  # NaN is not
)


def one_of(words: tuple[str, ...]) -> Kind:
    """One of these words."""
    return Kind(f"one of {', '.join(words)}", lambda x: isinstance(x, str) and x in words)


class Entry:
    """An object at a place in the file. ValueError gives the place of a missing or wrong value."""

    def __init__(self, value: Any, place: str = "") -> None:
        self._values, self._place = checked(value, OBJECT, place or "the whole"), place

    def get(self, key: str, kind: Kind, null: bool = False) -> Any:
        """The value of `key`; null: None is allowed too."""
        if key not in self._values:
            raise ValueError(f"{self.place(key)} is missing")
        value = self._values[key]
        return None if null and value is None else checked(value, kind, self.place(key))

    def each(self, key: str, kind: Kind) -> Iterator[tuple[Any, str]]:
        """The values of a list, each with its place."""
        for number, value in enumerate(self.get(key, LIST)):
            place = f"{self.place(key)}[{number}]"
            yield checked(value, kind, place), place

    def numbers(self, key: str) -> dict[str, float]:
        """An object with numbers only."""
        entry = Entry(self.get(key, OBJECT), self.place(key))
        return {name: entry.get(name, NUMBER) for name in entry._values}

    def place(self, key: str) -> str:
        """The place of a value in this object."""
        return f"{self._place}.{key}" if self._place else key

    def only(self, keys: tuple[str, ...]) -> None:
        """ValueError for any other key: an unknown value would be lost when the file is written again."""
        for key in self._values:
            if key not in keys:
                raise ValueError(f"this rover-sweep does not know {self.place(key)}")

    def __contains__(self, key: str) -> bool:
        return key in self._values


def checked(value: Any, kind: Kind, place: str) -> Any:
    """The value; ValueError where it is of another kind."""
    if not kind.holds(value):
        raise ValueError(f"{place} is {reprlib.repr(value)}, not {kind.words}")
    return value
