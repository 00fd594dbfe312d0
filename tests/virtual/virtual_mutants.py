"""The drive code with a rule taken out: a scenario that depends on the rule must notice.

assert noticed("rover_sweep.vehicle.run.right_to_move.RULES", without("reported"), CASES[name], tmp_path)
"""

from __future__ import annotations

from pathlib import Path
from unittest import mock

from virtual_matrix import Case
from virtual_promises import broken
from virtual_run import Outcome

from rover_sweep.vehicle.run import right_to_move
from rover_sweep.vehicle.run.right_to_move import Rule


def without(*names: str) -> tuple[Rule, ...]:
    """The rules of the right to move but for these."""
    assert {rule.__name__ for rule in right_to_move.RULES} >= set(names), names
    return tuple(rule for rule in right_to_move.RULES if rule.__name__ not in names)


def noticed(place: str, instead: object, case: Case, folder: Path) -> list[str]:
    """The promises that are broken in `case` with `place` (a dotted name) replaced by `instead`.

    AttributeError where there is no such place.
    """
    with mock.patch(place, instead):
        return problems(case, folder)


def problems(case: Case, folder: Path) -> list[str]:
    """What `broken` says of a case, and a benign one that does not come to its end."""
    return judged(case, case.played(folder))


def judged(case: Case, outcome: Outcome) -> list[str]:
    """The same of an outcome."""
    wrong = broken(outcome)
    if not outcome.fired:
        wrong.append("the fault did not happen")
    if case.benign and not (outcome.finished and outcome.finished.completed):
        wrong.append(f"a run that could have been completed was not: {outcome.said}")
    return wrong
