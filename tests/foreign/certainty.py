"""`python -m tests.foreign.certainty FILE...`: are findings right as often as they say?

FILE: what `python -m tests.foreign --json FILE` wrote. Prints a table of the said probability against the
share of right findings. --fit prints the weights of `rover_sweep.diagnosis.certainty` that fit these findings
best; the probabilities are then those by weights that were fitted to the other nine tenths. --picture FILE
draws the table.
A finding that is near the truth though the law is outside the list (`grade.NEAREST`) counts neither way.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from rover_sweep.diagnosis.certainty import measures, probability
from tests.foreign.grade import grade

Array = NDArray[np.float64]
EDGES = (0.0, 0.5, 0.7, 0.85, 0.95, 1.0)
RIDGE = 0.3  # one prior unit of each weight, so that few findings cannot make one infinite


@dataclass(frozen=True)
class Judged:
    """One finding: its measures, the probability that it said, and whether it is right."""

    z: dict[str, float]
    said: float
    right: bool


def judged(paths: Sequence[Path]) -> Iterator[Judged]:
    """The findings of all sets that are right or wrong."""
    for path in paths:
        for text in path.read_text().splitlines():
            one = json.loads(text)
            yield from _judged(one)


def _judged(one: dict[str, Any]) -> Iterator[Judged]:
    hidden = [h["effect"] for h in one["hidden"]]
    marks = grade(one["set"], "", hidden, one)
    for f in one["findings"]:
        said = probability(f["evidence"])
        if said is None or f["effect"] in marks.nearest:
            continue
        yield Judged(measures(f["evidence"]), said, f["effect"] in marks.first)


def fitted(found: Sequence[Judged]) -> dict[str, float]:
    """{measure: weight} of the logistic regression with a small ridge."""
    names = list(found[0].z)
    z = np.array([[f.z[n] for n in names] for f in found])
    right = np.array([f.right for f in found], float)

    def cost(w: Array) -> float:
        score = z @ w
        loss = np.logaddexp(0.0, score) - right * score
        return float(np.sum(loss) + 0.5 * RIDGE * np.sum(w[1:] ** 2))

    return dict(zip(names, minimize(cost, np.zeros(len(names))).x, strict=True))


def apart(found: Sequence[Judged], parts: int = 10) -> list[tuple[float, bool]]:
    """(probability by weights fitted to the other parts, whether right)."""
    out = []
    for k in range(parts):
        weights = fitted([f for j, f in enumerate(found) if j % parts != k])
        for f in found[k::parts]:
            score = sum(weights[n] * z for n, z in f.z.items())
            out.append((float(1.0 / (1.0 + np.exp(-score))), f.right))
    return out


def wilson(right: int, of: int) -> tuple[float, float]:
    """90 % interval of a share."""
    z, p = 1.645, right / of
    middle, reach = p + z * z / (2 * of), z * sqrt(p * (1 - p) / of + z * z / (4 * of * of))
    return (middle - reach) / (1 + z * z / of), (middle + reach) / (1 + z * z / of)


def table(pairs: Sequence[tuple[float, bool]]) -> list[tuple[float, int, int, float, float]]:
    """(mean said, findings, right, low, high) of each class of the said probability."""
    out = []
    for low, high in zip(EDGES, EDGES[1:], strict=False):
        inside = [(p, r) for p, r in pairs if low <= p < high or p == high == 1.0]
        if inside:
            right = sum(r for _, r in inside)
            mean = sum(p for p, _ in inside) / len(inside)
            out.append((mean, len(inside), right, *wilson(right, len(inside))))
    return out


def shown(rows: Sequence[tuple[float, int, int, float, float]]) -> str:
    head = "| said | findings | right | share (90 % interval) |\n|---|---|---|---|\n"
    return head + "\n".join(
        f"| {100 * said:.0f} % | {n} | {right} "
        f"| {100 * right / n:.0f} % ({100 * low:.0f} to {100 * high:.0f}) |"
        for said, n, right, low, high in rows
    )


def picture(rows: Sequence[tuple[float, int, int, float, float]], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure((4.2, 4.0), layout="constrained")
    ax = figure.subplots()
    ax.plot([0, 100], [0, 100], color="0.6", lw=1)
    for said, n, right, low, high in rows:
        ax.plot([100 * said] * 2, [100 * low, 100 * high], color="C0")
        ax.plot(100 * said, 100 * right / n, "o", color="C0")
        ax.annotate(f" {n}", (100 * said, 100 * right / n), va="center")
    ax.set(xlabel="said to be right [%]", ylabel="right [%]", xlim=(0, 100), ylim=(0, 102))
    ax.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.foreign.certainty", description=__doc__)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--picture", type=Path)
    args = parser.parse_args()
    found = list(judged(args.files))
    pairs = [(f.said, f.right) for f in found]
    if args.fit:
        print({name: round(float(value), 2) for name, value in fitted(found).items()})
        pairs = apart(found)
    rows = table(pairs)
    print(shown(rows))
    if args.picture:
        picture(rows, args.picture)


if __name__ == "__main__":
    main()
