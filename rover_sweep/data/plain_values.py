"""Python's own numbers in results: `1.5`, not `np.float64(1.5)`, where a result is printed."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np


class PlainNumbers:
    """Base of frozen dataclasses: numpy's scalars in their fields become Python's numbers."""

    def __post_init__(self) -> None:
        for f in fields(self):  # type: ignore[arg-type]  # of the dataclass that derives from it
            given = getattr(self, f.name)
            if (own := plain_value(given)) is not given:
                object.__setattr__(self, f.name, own)


def plain_value(value: Any) -> Any:
    """The value with Python's numbers for numpy's scalars, also in tuples and dicts; itself without any."""
    if isinstance(value, np.generic):
        return value.item()
    if type(value) is tuple:
        own = tuple(plain_value(v) for v in value)
        return own if any(a is not b for a, b in zip(own, value, strict=True)) else value
    if type(value) is dict:
        items = {k: plain_value(v) for k, v in value.items()}
        return items if any(items[k] is not v for k, v in value.items()) else value
    return value
