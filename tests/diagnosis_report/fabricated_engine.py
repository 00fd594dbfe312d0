"""An engine that answers with a diagnosis or a plan made by hand, and notes what it was given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from fabricated_diagnoses import EXPLAINED
from fabricated_plans import PLAN

from rover_sweep.diagnosis.plans.planner import Plan
from rover_sweep.diagnosis.result import Diagnosis

PLAIN = replace(EXPLAINED, overlays=(), mismatch=(), scores={})  # without pictures, which take their time


class ProgramResult(NamedTuple):
    """What a call of the program gave."""

    code: int
    out: str
    err: str


@dataclass
class Engine:
    """answer: what comes out, or what is raised; before: called while it works; given: arguments."""

    answer: Diagnosis | Exception = PLAIN
    plan: Plan = PLAN
    before: Callable[[Any], None] = lambda stop: None
    given: dict[str, Any] = field(default_factory=dict)

    def diagnose(
        self,
        runs: Any,
        rover: Any,
        settings: Any,
        held_out: Any = (),
        simulated: Any = (),
        progress: Any = None,
        stop: Any = None,
        groups: Any = None,
    ) -> Diagnosis:
        self.given = {"runs": runs, "rover": rover, "settings": settings}
        self.given |= {"held_out": held_out, "simulated": simulated}
        if progress:
            progress("scoring the candidates", 0.5)
        self.before(stop)
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def make_plan(
        self,
        runs: Any,
        rover: Any,
        rad_per_us: float,
        limits: Any,
        wanted: Any = (),
        spread: Any = None,
        driven: Any = None,
        progress: Any = None,
        settled: Any = None,
    ) -> Plan:
        self.given = {"runs": runs, "rover": rover, "rad_per_us": rad_per_us, "limits": limits}
        self.given |= {"wanted": wanted, "spread": spread, "driven": driven}
        progress("simulating a sweep", 0.5)
        return self.plan
