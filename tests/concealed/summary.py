"""The figures of the proof: rates with Wilson intervals, a confusion matrix, errors, coverage, seconds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from tests.concealed.grade import Graded

Z = 1.96


def wilson(hits: int, total: int) -> tuple[float, float]:
    """95 % interval of a rate (Wilson)."""
    if total == 0:
        return 0.0, 1.0
    rate, z2 = hits / total, Z * Z / total
    middle = (rate + z2 / 2) / (1 + z2)
    half = Z * np.sqrt(rate * (1 - rate) / total + z2 / total / 4) / (1 + z2)
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


def print_summary(graded: Sequence[Graded]) -> None:
    """Everything the closing note needs, as text."""
    if not graded:
        print("no answers to grade")
        return
    _rates(graded)
    _confusion(graded)
    _numbers(graded)


def _line(text: str, hits: int, total: int) -> None:
    low, high = wilson(hits, total)
    rate, span = 100 * hits / max(total, 1), f"({100 * low:.1f} .. {100 * high:.1f})"
    print(f"  {text:<46} {hits:4d}/{total:<4d} {rate:5.1f} %  {span}")


RULES: dict[str, list[tuple[str, tuple[str, ...]]]] = {
    "none": [("false alarm", ("false alarm",)), ("nothing named", ("none",))],
    "single": [
        ("exact", ("exact",)),
        ("exact or look-alike", ("exact", "look-alike")),
        ("wrong name", ("wrong",)),
        ("nothing or unknown said", ("missed",)),
    ],
    "double": [("both", ("both",)), ("at least one", ("both", "one")), ("wrong name", ("wrong",))],
    "deleted": [
        ("unknown or look-alike", ("unknown", "look-alike")),
        ("unknown", ("unknown",)),
        ("wrong name", ("wrong",)),
        ("nothing said", ("missed",)),
    ],
    "unknown": [
        ("unknown or nearest equivalent", ("unknown", "nearest")),
        ("unknown", ("unknown",)),
        ("wrong name", ("wrong",)),
        ("nothing said", ("missed",)),
    ],
}


def _rates(graded: Sequence[Graded]) -> None:
    for kind, rules in RULES.items():
        marks = [one.mark for one in graded if one.kind == kind]
        if not marks:
            continue
        print(f"{kind}: {len(marks)} sets")
        for text, good in [*rules, ("no answer", ("failed",))]:
            _line(text, sum(mark in good for mark in marks), len(marks))
    said = [one for one in graded if one.kind == "none" and one.verdict not in ("none",)]
    if any(one.kind == "none" for one in graded):
        _line("none sets whose verdict is not none", len(said), sum(one.kind == "none" for one in graded))


def _confusion(graded: Sequence[Graded]) -> None:
    """Rows: what was concealed; how often it was named what."""
    print("confusion (concealed: named x times)")
    rows: dict[str, Counter[str]] = {}
    for one in graded:
        said = " + ".join(sorted(one.named)) or one.verdict
        rows.setdefault(" + ".join(sorted(one.truth)) or "none", Counter())[said] += 1
    for truth in sorted(rows):
        print(f"  {truth:<46} {', '.join(f'{name} {n}' for name, n in rows[truth].most_common())}")
    for one in graded:
        if one.mark in ("wrong", "false alarm", "missed", "failed"):
            hidden, said = " + ".join(one.truth) or "none", " + ".join(one.named) or one.verdict
            print(f"  {one.name}: {one.mark}: {hidden} -> {said}")


def _numbers(graded: Sequence[Graded]) -> None:
    errors = [error for one in graded for error in one.errors]
    covered = [inside for one in graded for inside in one.covered]
    shares = [
        one.share
        for one in graded
        if one.share is not None and one.mark in ("exact", "look-alike", "both", "one")
    ]
    sizes = [size for one in graded for size in one.look_alikes]
    if errors:
        print(f"  median parameter error {100 * np.median(errors):.1f} % of {len(errors)}")
    if covered:
        _line("90 % intervals that hold the truth", sum(covered), len(covered))
    if shares:
        share = 100 * np.median(shares)
        print(f"  median share of the explainable held-out error removed {share:.0f} % ({len(shares)} sets)")
    if sizes:
        print(f"  look-alike sets: mean size {np.mean(sizes):.2f}, largest {max(sizes)}")
    seconds = [one.seconds for one in graded]
    print(f"  seconds a set: median {np.median(seconds):.1f}, largest {max(seconds):.1f}")
