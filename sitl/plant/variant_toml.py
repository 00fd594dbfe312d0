"""Untrusted TOML: a hostile or damaged text raises ValueError with a sentence."""

from __future__ import annotations

import tomllib
from typing import Any

LONGEST_LINE = 10_000  # characters; tomllib takes minutes for a key of 100,000 parts


def read_toml(text: str) -> dict[str, Any]:
    """The document; ValueError for anything else."""
    longest = max(map(len, text.split("\n")))
    if longest > LONGEST_LINE:
        raise ValueError(f"a line has {longest} characters; {LONGEST_LINE} are the most")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("brackets are nested too deeply") from None
