"""Marks of the answers, a table with a row for each engine and kind, and one of the said probabilities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, median
from typing import Any

from tests.foreign.grade import Graded, grade

HALVED = 0.5  # share of the held-out residual that the findings remove
HEADS = (
    "engine", "kind", "sets", "exact", "wrong name", "both of two", "alarms", "place right", "halved",
    "Brier", "median s", "max s",
)  # fmt: skip
ALL = "all"  # in the place of the engine, where there are several
EDGES = (0.5, 0.6, 0.75, 0.85, 0.95, 1.0)  # of the said probability
RELIABILITY_HEADS = ("said", "findings", "mean said", "right", "none", "mean said", "right")


@dataclass(frozen=True)
class Judged:
    """One answer. said: (printed probability, right) of each finding; halved: None without a held-out run.

    none: (P(none), nothing is hidden) where the answer has it. held: for each hidden effect that was not
    found but bounded, whether its value is within the bound.
    """

    engine: str
    kind: str
    marks: Graded
    said: tuple[tuple[float, bool], ...]
    halved: bool | None
    none: tuple[tuple[float, bool], ...] = ()
    held: tuple[bool, ...] = ()


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
    p_none = answer.get("p_none")
    none = () if p_none is None else ((float(p_none), not hidden),)
    return Judged(truth["engine"], truth["kind"], marks, said, _halved(answer), none, _held(truth, answer))


def _held(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> tuple[bool, ...]:
    """Only of values in the unit of a bounded parameter; other forms of a law have other parameters."""
    bounded = {one["effect"]: one["up_to"] for one in answer.get("cannot_see") or () if one.get("up_to")}
    found = []
    for one in truth["hidden"]:
        some = [b for b in bounded.get(one["effect"], {}).values() if b["unit"] == one.get("unit")]
        if some:
            found.append(any(within(float(one["value"]), b["low"], b["high"]) for b in some))
    return tuple(found)


def within(value: float, low: float | None, high: float | None) -> bool:
    """Whether a hidden value lies in the range of a parameter, whose sign may be the opposite.

    A range of ratios (low > 0) may also hold the value as a change from 1.
    """
    ratio = low is not None and high is not None and low > 0.0
    values = [value]
    if ratio and value:
        values += [1 / value, 1 + value, 1 - value]
    elif low is not None and low < 0.0:
        values.append(-value)
    return any((low is None or low <= v) and (high is None or v <= high) for v in values)


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
    """Rows of HEADS as Markdown; hits/sets, "-" where a column has no meaning for the kind.

    Then a row for each kind over all engines, where there are several.
    """
    rows: list[tuple[str, ...]] = [HEADS]
    for engine, kind in dict.fromkeys((one.engine, one.kind) for one in found):
        rows.append(_row(engine, kind, [one for one in found if (one.engine, one.kind) == (engine, kind)]))
    if len({one.engine for one in found}) > 1:
        kinds = dict.fromkeys(one.kind for one in found)
        rows += [_row(ALL, kind, [one for one in found if one.kind == kind]) for kind in kinds]
    return _markdown(rows)


def reliability(found: Sequence[Judged]) -> str:
    """Rows of RELIABILITY_HEADS as Markdown, and the share of upper bounds that hold the truth."""
    said = [pair for one in found for pair in one.said]
    none = [pair for one in found for pair in one.none]
    rows: list[tuple[str, ...]] = [RELIABILITY_HEADS]
    for low, high in pairwise(EDGES):
        cells = (*_bin(said, low, high), *_bin(none, low, high))
        rows.append((f"{low:.2f}-{high:.2f}", *cells))
    held = [hit for one in found for hit in one.held]
    return _markdown(rows) + f"\n\nupper bounds that hold the truth: {share(held)}"


def _bin(pairs: Sequence[tuple[float, bool]], low: float, high: float) -> tuple[str, str, str]:
    """Number, mean said and share right of those from `low` to below `high`; the last bin has its end."""
    some = [(p, right) for p, right in pairs if low <= p < high or p == high == EDGES[-1]]
    if not some:
        return "0", "-", "-"
    return str(len(some)), f"{fmean(p for p, _ in some):.2f}", f"{fmean(right for _, right in some):.2f}"


def _markdown(rows: Sequence[tuple[str, ...]]) -> str:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
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
        share([m.mark == "exact" for m in marks]) if kind not in ("none", "outside") else "-",
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
