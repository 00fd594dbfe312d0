"""Sentences on a terminal."""

from __future__ import annotations

import shutil
import textwrap


def bullet(mark: str, text: str) -> str:
    """`text` wrapped to the terminal (at most 100 columns), indented by two, hanging behind `mark`."""
    width = min(shutil.get_terminal_size((100, 24)).columns, 100)
    indent = " " * (len(mark) + 3)
    return textwrap.fill(text, width, initial_indent=f"  {mark} ", subsequent_indent=indent)
