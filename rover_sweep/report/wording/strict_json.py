"""JSON that every reader accepts: no NaN, no Infinity, keys in insertion order."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rover_sweep.files.printable import within_json


def plain(value: Any) -> Any:
    """The value in plain JSON types; numbers that are not finite become None. TypeError for other types."""
    match value:
        case None | bool() | str():
            return value
        case np.ndarray() | np.generic():
            return plain(value.tolist())
        case int():
            return int(value)
        case float():
            return float(value) if math.isfinite(value) else None
        case Mapping():
            return {str(key): plain(item) for key, item in value.items()}
        case list() | tuple():
            return [plain(item) for item in value]
    raise TypeError(f"{type(value).__name__} cannot be written as JSON: {value!r}")


def strict_json(value: Any) -> str:
    """Indented strict JSON, lists of numbers and of short words on one line, with a newline at the end."""
    return within_json(_text(plain(value), 0)) + "\n"


def _text(value: Any, depth: int) -> str:
    inner, outer = "  " * (depth + 1), "  " * depth
    if isinstance(value, dict) and value:
        items = (f"{inner}{json.dumps(key)}: {_text(item, depth + 1)}" for key, item in value.items())
        return "{\n" + ",\n".join(items) + f"\n{outer}}}"
    if isinstance(value, list) and any(
        isinstance(item, dict | list) or len(str(item)) > 30 for item in value
    ):
        return "[\n" + ",\n".join(inner + _text(item, depth + 1) for item in value) + f"\n{outer}]"
    return json.dumps(value, allow_nan=False, ensure_ascii=False)
