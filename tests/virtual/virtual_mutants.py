"""The drive code with one of its rules taken out: a scenario that depends on the rule must notice.

CAUGHT_BY = {"rover_sweep.vehicle.guard._heard": ("hole down inf s @ sweep + 0.3 s",)}
assert noticed("rover_sweep.vehicle.guard._heard", lambda *_: "", CASES[name], tmp_path)
"""

from __future__ import annotations

from pathlib import Path
from unittest import mock

from virtual_matrix import Case
from virtual_promises import broken


def noticed(rule: str, instead: object, case: Case, folder: Path) -> list[str]:
    """The promises that are broken in `case` with the rule (a dotted name) replaced by `instead`.

    ValueError where the case breaks a promise with the rule in place: then it says nothing on the rule.
    AttributeError where there is no such rule.
    """
    if before := problems(case, folder / "whole"):
        raise ValueError(f"{case.name} fails without the mutant too: {before}")
    with mock.patch(rule, instead):
        return problems(case, folder / "mutant")


def problems(case: Case, folder: Path) -> list[str]:
    """What `broken` says of a case, and a benign one that does not come to its end."""
    outcome = case.played(folder)
    wrong = broken(outcome)
    if not outcome.fired:
        wrong.append("the fault did not happen")
    if case.benign and not (outcome.finished and outcome.finished.completed):
        wrong.append(f"a run that could have been completed was not: {outcome.said}")
    return wrong
