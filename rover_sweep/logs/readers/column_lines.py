"""Lines of a column map, each with its certainty and its reason."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class FoundColumn:
    """A line of the column map. channel: its key; entry: its value, None where it stays undecided.

    certainty: "certain", "likely" or "a guess". also: lines to write instead of it, as comments;
    alike: the same for other columns that fit alike.
    """

    channel: str
    entry: Any
    certainty: str
    reason: str
    also: tuple[str, ...] = ()
    alike: tuple[str, ...] = ()

    def lines(self) -> Iterator[str]:
        """Its text in the map."""
        yield f"# {self.certainty}: {self.reason}" if self.entry is not None else f"# {self.reason}"
        if self.entry is not None:
            yield f"{self.channel} = {toml_value(self.entry)}"
        yield from (f"# {line}" for line in (*self.also, *self.alike))


def toml_value(value: Any) -> str:
    """A value of the map as TOML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k} = {toml_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return json.dumps(value, ensure_ascii=False)


def column_entry(name: str | dict[str, Any], unit: str, own: str, more: Mapping[str, Any]) -> Any:
    """Of a column, or of what several columns make."""
    extra = {**({"unit": unit} if unit != own else {}), **more}
    if isinstance(name, dict):
        return {**name, **extra}
    return {"column": name, **extra} if extra else name


def certainty_of(evidence: int) -> str:
    return "certain" if evidence >= 3 else "likely" if evidence == 2 else "a guess"
