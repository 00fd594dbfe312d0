"""Wrapped text on a terminal."""

from __future__ import annotations

import shutil
import textwrap

WIDTH = 80


def bullet(mark: str, text: str) -> str:
    """`text` wrapped to the terminal (at most 80 columns), indented by two, with `mark` before it."""
    return _hanging(f"  {mark} ", text)


def fact(name: str, text: str) -> str:
    """`name` and `text` in two columns, wrapped likewise."""
    return _hanging(f"  {name:<16}", text)


def _hanging(head: str, text: str) -> str:
    width = min(shutil.get_terminal_size((WIDTH, 24)).columns, WIDTH)
    return textwrap.fill(text, width, initial_indent=head, subsequent_indent=" " * len(head))
