"""Show the doctests of docstrings as code: an extension of Griffe, which reads the docstrings."""

from __future__ import annotations

import re
from typing import Any

import griffe

DOCTEST = re.compile(r"^>>> .*\n(?:(?!\n).+\n?)*", re.MULTILINE)


class DoctestFences(griffe.Extension):
    def on_instance(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Put each doctest between fences, so that Markdown does not read its brackets as links."""
        if obj.docstring:
            obj.docstring.value = DOCTEST.sub(
                lambda m: f"```pycon\n{m[0].rstrip()}\n```\n", obj.docstring.value + "\n"
            )
