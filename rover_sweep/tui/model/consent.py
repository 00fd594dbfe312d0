"""The question before a run: what this program will do, what speaks against it."""

from __future__ import annotations

from collections.abc import Sequence

from rover_sweep.tui.drawn import labels
from rover_sweep.tui.model.plan_rows import Row, ground
from rover_sweep.tui.model.setup import Setup
from rover_sweep.tui.model.state import RunRecord, State
from rover_sweep.vehicle.preflight.item import Check


def question_before(row: Row, setup: Setup, state: State) -> str:
    """The question; "" if there is none, as the pilot does everything and the run is not kept already."""
    kept, own = is_kept(row, state.runs), setup.own_part
    if not kept and not own:
        return ""
    parts = [
        f"{row.name}: {labels.manoeuvre(row.manoeuvre)} at {row.speed:g} m/s, "
        f"{labels.seconds(row.manoeuvre.duration)}{ground(row, setup.vehicle)}."
    ]
    if kept:
        parts.append(f"{row.name} is already KEEP: there is no need to drive it again.")
    parts.append(bad_checks(state.checks))
    if own:
        parts.append(f"This program {', '.join(own)}.")
    return "\n\n".join((*parts, "Is the area clear of people and obstacles?"))


def bad_checks(checks: Sequence[Check]) -> str:
    """A sentence on how many of the checks are bad, and which."""
    bad = [check.name.replace("_", " ") for check in checks if check.state == "bad"]
    if not checks:
        return "The checks were NOT RUN: view 2, R."
    if not bad:
        return f"None of the {len(checks)} checks is BAD."
    verb = "is" if len(bad) == 1 else "are"
    return f"{len(bad)} of {len(checks)} checks {verb} BAD: {', '.join(bad)} (view 2)."


def is_kept(row: Row, runs: Sequence[RunRecord]) -> bool:
    """True if the latest run of the row has the verdict to keep it."""
    latest = next(reversed(driven_for(row, runs)), None)
    return latest is not None and latest.verdict is not None and latest.verdict.advice == "keep"


def driven_for(row: Row, runs: Sequence[RunRecord]) -> list[RunRecord]:
    """The runs of a row of the plan, oldest first."""
    return [run for run in runs if run.name == row.name and run.manoeuvre == row.manoeuvre]
