"""Docstrings as the API page shows them: parameters in a table, doctests as code. An extension of Griffe."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import griffe

DOCTEST = re.compile(r"^>>> .*\n(?:(?!\n).+\n?)*", re.MULTILINE)
RAISES = re.compile(r"(?:^|(?<=\. ))\w*(?:Error|Refused) (?:for|when|if|without)\b")


class DoctestFences(griffe.Extension):
    def on_instance(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Rewrite a docstring: a table of the parameters, and fences round each doctest.

        Without the fences Markdown would read the brackets of a doctest as links.
        """
        if not obj.docstring:
            return
        text = with_table(obj.docstring.value, _parameters(obj))
        obj.docstring.value = DOCTEST.sub(lambda m: f"```pycon\n{m[0].rstrip()}\n```\n", text + "\n")


def _parameters(obj: griffe.Object) -> dict[str, tuple[str, str]]:
    """{parameter or field: (type, default)}."""
    if obj.is_class:
        fields = {n: m for n, m in obj.members.items() if m.is_attribute and not n.startswith("_")}
        return {n: (str(m.annotation or ""), str(m.value or "")) for n, m in fields.items()}
    given = [p for p in getattr(obj, "parameters", ()) if p.name not in ("self", "cls")]
    return {p.name: (str(p.annotation or ""), str(p.default or "")) for p in given}


def with_table(text: str, parameters: Mapping[str, tuple[str, str]]) -> str:
    """A docstring whose "name: meaning" sentences are rows of a table, what it raises behind that.

    The text is as it was where it names no parameter.
    """
    found, rest, raises = dict[str, str](), list[str](), list[str]()
    for paragraph in text.strip().split("\n\n"):
        meanings, before, after = ({}, paragraph, "")
        if not paragraph.startswith((">>>", "    ")):
            meanings, before, after = _meanings(" ".join(paragraph.split()), tuple(parameters))
        if not meanings:
            rest.append(paragraph)
            continue
        found |= meanings
        rest += [before] if before else []
        raises += [after] if after else []
    if not found:
        return text
    heading = ["| parameter | type | default | meaning |", "| --- | --- | --- | --- |"]
    rows = [_row(name, *parameters[name], found.get(name, "")) for name in parameters if name in found]
    at = next((k for k, part in enumerate(rest) if part.startswith(">>>") or part.endswith(":")), len(rest))
    return "\n\n".join([*rest[:at], "\n".join([*heading, *rows]), *raises, *rest[at:]])


def _meanings(flat: str, names: Sequence[str]) -> tuple[dict[str, str], str, str]:
    """({name: meaning}, what is before them, what it raises) of a paragraph on one line."""
    one = "|".join(sorted(names, key=len, reverse=True)) or "(?!)"
    start = rf"(?:^|(?<=[.;] ))((?:{one})(?:, (?:{one}))*)(?=: | \[[^\]]*\](?:[:;.,]|$)|\([^)]*\)[.:;,])"
    begins = list(re.finditer(start, flat))
    found, raises = dict[str, str](), ""
    for k, begin in enumerate(begins):
        end = begins[k + 1].start() if k + 1 < len(begins) else len(flat)
        meaning = flat[begin.end() : end].lstrip(":").strip().rstrip(";.").strip()
        if (error := RAISES.search(meaning)) is not None:
            meaning, raises = meaning[: error.start()].strip().rstrip("."), meaning[error.start() :] + "."
        found |= dict.fromkeys(begin[1].split(", "), meaning)
    return found, flat[: begins[0].start()].strip() if begins else flat, raises


def _row(name: str, kind: str, default: str, meaning: str) -> str:
    kind = kind.replace(" | ", " or ").replace("|", " or ")
    cells = (f"`{name}`", f"`{kind}`" if kind else "", f"`{default}`" if default else "", meaning)
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"
