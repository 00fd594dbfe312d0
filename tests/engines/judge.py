"""Marks of the answers, and a table with a row for each engine and kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from tests.foreign.grade import Graded, grade

HALVED = 0.5  # share of the held-out residual that the findings remove
HEADS = (
    "engine",
    "kind",
    "sets",
    "exact",
    "wrong name",
    "both of two",
    "alarms",
    "place right",
    "halved",
    "Brier",
    "median s",
    "max s",
)


@dataclass(frozen=True)
class Judged:
    """One answer. said: (printed probability, right) of each finding; halved: None without a held-out run."""

    engine: str
    kind: str
    marks: Graded
    said: tuple[tuple[float, bool], ...]
    halved: bool | None


def judged(
    truth: Mapping[str, Any], answer: Mapping[str, Any], places: Mapping[str, tuple[str, ...]]
) -> Judged:
    """Marks of an answer to a set. truth: as in `BenchSet`.

    A finding counts as right if its own name is hidden; one that is near the truth does not count.
    """
    hidden = [one["effect"] for one in truth["hidden"]]
    marks = grade(str(truth["seed"]), truth["kind"], hidden, answer, places)
    said = tuple(
        (float(one["probability"]), one["effect"] in marks.first)
        for one in answer["findings"]
        if one.get("probability") is not None and one["effect"] not in marks.nearest
    )
    return Judged(truth["engine"], truth["kind"], marks, said, _halved(answer))


def _halved(answer: Mapping[str, Any]) -> bool | None:
    """By all findings together; an answer that removes nothing has not halved it."""
    if not answer.get("held_out"):
        return None
    share = removed(answer["held_out"])
    return share is not None and share >= HALVED


def removed(held_out: Any) -> float | None:
    """share_removed of a held-out document, of one run or of several."""
    if isinstance(held_out, Mapping):
        share = held_out.get("share_removed")
        return float(share) if share is not None else None
    if isinstance(held_out, Sequence) and not isinstance(held_out, str):
        shares = [share for share in map(removed, held_out) if share is not None]
        return min(shares) if shares else None
    return None


def brier(said: Sequence[tuple[float, bool]]) -> float | None:
    """Mean square of (probability - right); None without a finding (Brier 1950)."""
    return sum((p - right) ** 2 for p, right in said) / len(said) if said else None


def table(found: Sequence[Judged]) -> str:
    """Rows of HEADS as Markdown; hits/sets, "-" where a column has no meaning for the kind."""
    rows = [HEADS]
    for engine, kind in dict.fromkeys((one.engine, one.kind) for one in found):
        rows.append(_row(engine, kind, [one for one in found if (one.engine, one.kind) == (engine, kind)]))
    widths = [max(len(row[k]) for row in rows) for k in range(len(HEADS))]
    lines = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |" for row in rows
    ]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)


def _row(engine: str, kind: str, some: Sequence[Judged]) -> tuple[str, ...]:
    marks = [one.marks for one in some]
    score = brier([pair for one in some for pair in one.said])
    placed = [m.placed for m in marks if m.placed is not None]
    halved = [one.halved for one in some if one.halved is not None]
    seconds = [m.seconds for m in marks]
    return (
        engine,
        kind,
        str(len(some)),
        share([m.mark == "exact" for m in marks]) if kind in ("single", "double") else "-",
        share([bool(m.wrong) for m in marks]),
        share([len(m.first) == 2 for m in marks]) if kind == "double" else "-",
        share([bool(m.named) for m in marks]) if kind == "none" else "-",
        share(placed) if placed else "-",
        share(halved) if halved and kind != "none" else "-",
        f"{score:.3f}" if score is not None else "-",
        f"{median(seconds):.0f}",
        f"{max(seconds):.0f}",
    )


def share(hits: Sequence[bool]) -> str:
    """ "hits/sets"."""
    return f"{sum(hits)}/{len(hits)}"
