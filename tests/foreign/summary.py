"""Rates with Wilson intervals for each kind, and a line for each set."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt
from statistics import median
from typing import Any

from tests.foreign.grade import Graded

Z = 1.96  # of a 95 % interval
RATES: dict[str, Callable[[Graded], bool]] = {
    "exact": lambda g: g.mark == "exact" or g.mark == "none",
    "with look-alikes": lambda g: g.mark in ("exact", "look-alike", "none"),
    "at least one": lambda g: bool(g.first or g.alike) or g.mark == "none",
    "wrong name": lambda g: bool(g.wrong),
    "wrong, explained": lambda g: bool(g.wrong) and g.verdict == "explained",
    "nearest": lambda g: bool(g.nearest),
    "unknown only": lambda g: g.unknown and not g.named,
    "nothing said": lambda g: not g.unknown and not g.named and g.verdict not in ("failed", "refused"),
    "refused, failed": lambda g: g.verdict in ("failed", "refused"),
}


def wilson(hits: int, total: int) -> tuple[float, float]:
    """95 % interval of a rate (Wilson 1927)."""
    if not total:
        return 0.0, 1.0
    rate, z2 = hits / total, Z * Z / total
    middle, half = rate + z2 / 2, Z * sqrt(rate * (1 - rate) / total + z2 / total / 4)
    return max(0.0, (middle - half) / (1 + z2)), min(1.0, (middle + half) / (1 + z2))


def table(graded: Sequence[Graded]) -> str:
    """A block for each kind: hits, sets, rate and interval in %; the median time."""
    lines = []
    for kind in dict.fromkeys(g.kind for g in graded):
        some = [g for g in graded if g.kind == kind]
        lines.append(f"{kind}: {len(some)} sets, median {median(g.seconds for g in some):.0f} s")
        for name, rule in RATES.items():
            hits = sum(map(rule, some))
            low, high = wilson(hits, len(some))
            rate, span = 100 * hits / len(some), f"({100 * low:.0f} .. {100 * high:.0f})"
            lines.append(f"  {name:<18}{hits:4d}/{len(some):<4d} {rate:5.1f} %  {span}")
        placed = [g.placed for g in some if g.placed is not None]
        if placed:
            low, high = wilson(sum(placed), len(placed))
            rate, span = 100 * sum(placed) / len(placed), f"({100 * low:.0f} .. {100 * high:.0f})"
            lines.append(f"  {'place right':<18}{sum(placed):4d}/{len(placed):<4d} {rate:5.1f} %  {span}")
    return "\n".join(lines)


def line(graded: Graded, answer: dict[str, Any], truth: str = "") -> str:
    """One set: mark, truth beside findings (with look-alikes and share removed), unknown, time."""
    said = "; ".join(_finding_words(one) for one in answer["findings"]) or "-"
    unknown = answer.get("unknown")
    where = (unknown.get("place") or unknown["channel"], unknown.get("law") or "") if unknown else ()
    place = f"  unknown: {' '.join(where)}" if where else ""
    truth = truth or ", ".join(graded.hidden) or "none"
    verdict = answer["verdict"]
    why = f" ({answer['sentence'].strip().splitlines()[-1]})" if verdict in ("failed", "refused") else ""
    return f"{graded.name:<7}{graded.mark:<11}{truth} | {verdict}{why}: {said}{place}  {graded.seconds:.0f} s"


def _finding_words(one: dict[str, Any]) -> str:
    values = ", ".join(f"{name} {v['value']:.3g}" for name, v in one["parameters"].items())
    removed = (one.get("held_out") or {}).get("share_removed")
    parts = [one["effect"], f"({values})" if values else "", f"[{one['form']}]" if one.get("form") else ""]
    parts += [f"p {one['probability']:.2f}"] if one.get("probability") is not None else []
    parts += [f"or {'/'.join(one['look_alikes'])}"] if one["look_alikes"] else []
    parts += [f"{100 * removed:.0f} %"] if removed is not None else []
    return " ".join(part for part in parts if part)
