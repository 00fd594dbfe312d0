"""The curve of something without a name: the family with the largest evidence, fitted in the simulation.

It is fitted together with the nominal coordinates, and has a 90 % band. The evidence of the families at one
place, summed, is what that place explains; places that share it are alternatives. Runs that are held out
judge the curve and choose nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.held_out.worth import EXPLAINABLE
from rover_sweep.diagnosis.posterior.model_fit import ModelFit
from rover_sweep.diagnosis.posterior.unnamed import UnnamedFamily, families
from rover_sweep.diagnosis.posterior.weights import COARSE, POWER
from rover_sweep.diagnosis.problem.least_squares import WEAK, Fitted, fit, prior_information, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import LawHeldOut
from rover_sweep.diagnosis.simulation.nominal import Coordinate
from rover_sweep.diagnosis.simulation.table_law import TableLaw, with_laws

LEAST = 5.0  # ln of the evidence from which there is a place
SHARE = 0.15  # probability from which another place is an alternative
REMOVED = 0.2  # least share of the held-out residual above the floor that a curve removes


@dataclass(frozen=True, eq=False)
class FoundLaw:
    """The most probable family, with its curve. alternatives: other places that explain nearly as much.

    gain: drop of the cost. fitted: the model with the curve, on the rows of the used runs; None for a
    resonance. held_out: of each held-out run.
    """

    law: TableLaw
    alternatives: tuple[str, ...]
    gain: float
    fitted: Fitted | None
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
        """True where it has a curve that removes enough of the held-out residual and makes no run worse."""
        share = self.share_removed
        worse = any(h.after > max(h.before, EXPLAINABLE) for h in self.held_out)
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
    law, fitted = fit_law(problem, base, best.law, best.amounts(base.overdispersion))
    judged = tuple(_judged(n, p, base, fitted) for n, p in held_out.items())
    return FoundLaw(law, alternatives, base.cost - fitted.cost, fitted, judged)


def _places(every: Sequence[UnnamedFamily], variance: float, best: UnnamedFamily) -> tuple[str, ...]:
    """The other places with a share of the probability, the most probable one first."""
    logs = np.array([POWER * f.evidence(variance) for f in every])
    weights = np.exp(logs - logs.max())
    share: dict[str, float] = {}
    for f, w in zip(every, weights / weights.sum(), strict=True):
        share[f.law.place] = share.get(f.law.place, 0.0) + float(w)
    others = [p for p in share if p != best.law.place and share[p] >= SHARE]
    return tuple(sorted(others, key=lambda p: -share[p]))


def _judged(name: str, held: Problem, base: Fitted, best: Fitted) -> LawHeldOut:
    before, after = (
        float(np.mean((held.measured - held.model(f.structure, f.x)) ** 2)) for f in (base, best)
    )
    share = (after - 1.0) / (before - 1.0) if before > EXPLAINABLE else None
    return LawHeldOut(name, before, after, share)


def fit_law(problem: Problem, base: Fitted, law: TableLaw, start: Array) -> tuple[TableLaw, Fitted]:
    """The law fitted from the amounts `start` (k,) of its points, and its model; the base's Jacobian is kept.

    A prior of ten sizes of the curve holds points that no run visited.
    """
    size = float(np.max(np.abs(start))) or 1e-6
    names = [f"law1.y{j}" for j in range(start.size)]
    free = (*base.free, *(Coordinate(name, 0.0, -np.inf, np.inf, size, 10.0 * size) for name in names))
    x = {**base.x, **dict(zip(names, start.tolist(), strict=True))}
    structure = with_laws(base.structure, [law])
    found = fit(problem, structure, free, x, steps=5, known=base, tolerance=5e-4 * base.cost)
    return replace(law, y=tuple(found.x[name] for name in names)), found


def curve_of(problem: Problem, law: TableLaw, fitted: Fitted) -> tuple[Array, Array]:
    """(y (k,), half width (k,) of its 90 % interval) of a fitted law, relative to its reference.

    The reference is the value at x = 0, or the mean where the range does not hold 0: a constant is not
    separable from trim, biases and stiffness. The noise is scaled to the residual that is left.
    """
    fresh = sensitivities(problem, fitted)
    weight = prior_information(fresh.free, absent=WEAK)
    covariance = np.linalg.inv(fresh.jacobian.T @ fresh.jacobian + np.diag(weight)) * fresh.overdispersion
    at = [k for k, c in enumerate(fresh.free) if c.name.startswith("law")]
    scale, x = np.array([fresh.free[k].scale for k in at]), np.array(law.x)
    reference = np.full(x.size, 1.0 / x.size)
    if x[0] < 0.0 < x[-1]:
        reference = np.array([np.interp(0.0, x, one) for one in np.eye(x.size)])
    shifted = np.eye(x.size) - reference[None, :]
    part = shifted @ (covariance[np.ix_(at, at)] * np.outer(scale, scale)) @ shifted.T
    return shifted @ np.array(law.y), ndtri(0.95) * np.sqrt(np.diag(part))
