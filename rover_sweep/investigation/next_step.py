"""The decision after a diagnosis, as frozen values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from rover_sweep.diagnosis.plans.next_run import Odds
from rover_sweep.diagnosis.plans.plan_result import PlannedRun

Action = Literal["drive", "settled", "used up", "open"]


@dataclass(frozen=True)
class NextStep:
    """What to do now, and why.

    action: "drive" `run`; "settled"; "used up": runs, ground or battery; "open": no run would tell more.
    reason: a sentence. effects: named by the diagnosis. run: only with "drive". bits: what it is expected to
    tell about the explanations, which are as probable as `odds` now; None where the plan does not know.
    """

    action: Action
    reason: str
    effects: tuple[str, ...] = ()
    run: PlannedRun | None = None
    bits: float | None = None
    odds: Odds = field(default_factory=dict)


@dataclass(frozen=True)
class Means:
    """What is left to drive with. choices: the runs that limits and ground allow, empty where none does.

    runs_left: number of runs. spent: why nothing more can be driven at all, "" while something can.
    """

    choices: tuple[PlannedRun, ...]
    runs_left: int
    spent: str = ""
