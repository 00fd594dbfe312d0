"""Draws sets and diagnoses them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

from tests.foreign.answer import answered
from tests.foreign.draw import draw
from tests.foreign.grade import Graded, grade
from tests.foreign.recorded import runs_of

Result = tuple[Graded, dict[str, Any], dict[str, Any]]


def diagnosed_sets(kinds: Sequence[str], seeds: range, jobs: int = 1) -> Iterator[Result]:
    """(marks, answer, truth) of each set, in their order."""
    wanted = [(kind, seed) for kind in kinds for seed in seeds]
    if jobs == 1:
        yield from map(_one, wanted)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(_one, wanted)


def _one(wanted: tuple[str, int]) -> Result:
    kind, seed = wanted
    drawn = draw(kind, seed)
    runs, held_out = runs_of(drawn.rover, drawn.plan, seed)
    found = answered(runs, held_out)
    return grade(str(seed), kind, [one.effect for one in drawn.hidden], found), found, drawn.truth()


def truth_words(truth: dict[str, Any]) -> str:
    """Size of the rover, and each hidden law with its form and value."""
    laws = (f"{h['effect']} [{h['form']}] {h['value']:.3g} ({h['visibility']:.2g})" for h in truth["hidden"])
    return f"{truth['size']}: " + (", ".join(laws) or "none")
