"""Diagnoses and runs made by hand for the rules of an investigation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rover_sweep.diagnosis.plans.plan import Odds, RunValue
from rover_sweep.diagnosis.plans.planner import PlannedRun
from rover_sweep.diagnosis.result import Diagnosis, Finding, Fit, HeldOut, Unknown, Unseen, UpperBound
from rover_sweep.investigation.decide import Means

SWEEP, DOUBLET = PlannedRun("sweep", 200.0, 2.4), PlannedRun("doublet", 120.0, 2.4)
SLOW = PlannedRun("sweep", 240.0, 1.4)
DRIVEN = (replace(SWEEP, name="sweep1"), replace(DOUBLET, name="doublet1"))
MEANS = Means((SLOW, PlannedRun("multisine", 200.0, 2.4)), 4)
PLAY = Finding(
    "steering_backlash",
    (),
    (),
    {"gain": 400.0, "threshold": 20.0},
    (HeldOut("doublet1", Fit(4.0, 0.2), Fit(1.0, 0.05), 0.9),),
    "",
    "play",
    "",
    probability=0.95,
)
SCORES = {"steering_backlash": 400.0, "steering_deadband": 380.0, "roll_steer": 20.0}


def explained(*findings: Finding) -> Diagnosis:
    """The verdict explained by these findings."""
    return Diagnosis("explained", "play", "roll-yaw", findings=findings, scores=SCORES)


def unexplained(*findings: Finding) -> Diagnosis:
    """A misfit without a name, in addition to the findings."""
    verdict = "partly explained" if findings else "unexplained"
    left = Unknown("r", "amplitude", 3.0, "r differs by 3 times the noise; nothing explains it")
    return Diagnosis(verdict, "r differs", "roll-yaw", findings=findings, unknown=left, scores=SCORES)


def nothing_missing(**times: float) -> Diagnosis:
    """The verdict none; times: {effect: its bound over the size that matters}."""
    hidden = tuple(
        Unseen(e, "a smaller one may not show", {"T": UpperBound("s", 0.0, 0.07 * x, 0.07)}, 0.1, x > 1)
        for e, x in times.items()
    )
    return Diagnosis("none", "nothing is missing", "roll-yaw", cannot_see=hidden)


class Ranking:
    """Remembers the odds, and answers with the given runs."""

    def __init__(self, *found: RunValue) -> None:
        self.found, self.asked = found, list[Odds]()

    def __call__(self, odds: Odds) -> Sequence[RunValue]:
        self.asked.append(odds)
        return self.found
