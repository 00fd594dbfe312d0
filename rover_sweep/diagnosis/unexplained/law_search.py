"""The curve of something without a name: the family with the largest evidence, fitted in the simulation.

The evidence of the families at one place, summed, is what that place explains; places that share it are
alternatives. Runs that are held out judge the curve and choose nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.diagnosis.posterior.model_fit import ModelFit
from rover_sweep.diagnosis.posterior.unnamed import UnnamedFamily, families
from rover_sweep.diagnosis.posterior.weights import COARSE, POWER
from rover_sweep.diagnosis.problem.least_squares import Fitted, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import LawHeldOut
from rover_sweep.diagnosis.simulation.table_law import TableLaw
from rover_sweep.diagnosis.unexplained.curve_fit import FittedLaws, fit_laws

LEAST = 5.0  # ln of the evidence from which there is a place
SHARE = 0.15  # probability from which another place is an alternative
REMOVED = 0.2  # least share of the held-out residual above the floor that a curve removes
WORSE = 0.02  # rise of a held-out run's mean square at which a curve does not hold
EXPLAINABLE = 1.05  # mean square of the rows above which a share is computed


@dataclass(frozen=True, eq=False)
class FoundLaw:
    """The most probable family. alternatives: other places that explain nearly as much. fitted: its curve in
    the simulation, None for a resonance. held_out: of each held-out run. gain: drop of the cost."""

    law: TableLaw
    alternatives: tuple[str, ...]
    gain: float
    fitted: FittedLaws | None
    held_out: tuple[LawHeldOut, ...] = ()

    @property
    def share_removed(self) -> float | None:
        """Share of the held-out residual above the floor that it removes; None where no run can judge it."""
        judged = [h for h in self.held_out if h.share_left is not None]
        before, after = (
            sum(v - 1.0 for v in vs) for vs in ([h.before for h in judged], [h.after for h in judged])
        )
        return 1.0 - after / before if judged else None

    @property
    def holds(self) -> bool:
        """True where it has a curve, and that removes enough of the held-out runs that can judge it."""
        share = self.share_removed
        worse = any(h.after > h.before + WORSE for h in self.held_out)
        return self.fitted is not None and not worse and (share is None or share >= REMOVED)


def find_law(
    last: ModelFit, held_out: Mapping[str, Problem], known: Sequence[UnnamedFamily] = ()
) -> FoundLaw | None:
    """The family that explains most of what a model leaves, None where none has evidence.

    It is chosen in the metric of the tolerances, and its curve fitted without them. held_out: {run: its
    problem}. known: the families of what the model leaves, where they were computed.
    """
    problem = last.problem.plain
    base = sensitivities(problem, last.closest)
    variance = COARSE * last.fitted.overdispersion
    every = known or families(last.problem, last.fitted)
    best = max(every, key=lambda f: f.evidence(variance))
    if best.evidence(variance) < LEAST:
        return None
    alternatives = _places(every, variance, best)
    if best.law.memory == "resonance":
        return FoundLaw(best.law, alternatives, 2.0 * variance * best.evidence(variance), None)
    fitted = fit_laws(problem, base, [best.law], [best.amounts(base.overdispersion)], known=True)
    judged = tuple(_judged(n, p, base, fitted) for n, p in held_out.items())
    return FoundLaw(fitted.laws[0], alternatives, base.cost - fitted.fitted.cost, fitted, judged)


def _places(every: Sequence[UnnamedFamily], variance: float, best: UnnamedFamily) -> tuple[str, ...]:
    """The other places with a share of the probability, the most probable one first."""
    logs = np.array([POWER * f.evidence(variance) for f in every])
    weights = np.exp(logs - logs.max())
    share: dict[str, float] = {}
    for f, w in zip(every, weights / weights.sum(), strict=True):
        share[f.law.place] = share.get(f.law.place, 0.0) + float(w)
    others = [p for p in share if p != best.law.place and share[p] >= SHARE]
    return tuple(sorted(others, key=lambda p: -share[p]))


def _judged(name: str, held: Problem, base: Fitted, best: FittedLaws) -> LawHeldOut:
    before, after = (
        float(np.mean((held.measured - held.model(f.structure, f.x)) ** 2)) for f in (base, best.fitted)
    )
    share = (after - 1.0) / (before - 1.0) if before > EXPLAINABLE else None
    return LawHeldOut(name, before, after, share)
