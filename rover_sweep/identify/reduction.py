"""Model structure reduction as Tischler & Remple 2012 do it: drop, re-converge, keep if J hardly rises."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.identify.fit import Condition, Estimate, FitResult, fit, silent

INSENSITIVITY_LIMIT = 10.0  # percent
CRAMER_RAO_LIMIT = 20.0  # percent
COST_RISE = 0.05  # of J_ave, plus one unit of J: what a dropped parameter may cost
MARGIN = 1e-3  # rad/s, by which an integrator's computed pole may miss 0


@dataclass(frozen=True)
class ReductionStep:
    """One attempt: the parameter, why it was tried, J_ave before and after, whether the drop was kept.

    unstable: kept because the model, stable before, was unstable without it.
    """

    parameter: str
    reason: str
    before: float
    after: float
    dropped: bool
    unstable: bool = False


def reduce(start: FitResult, conditions: Sequence[Condition]) -> tuple[FitResult, tuple[ReductionStep, ...]]:
    """Drops (sets to zero) the worst parameter, one at a time, while J_ave hardly rises.

    First the worst insensitivity above 10 %, then the worst Cramer-Rao bound above 20 %. A parameter
    whose loss costs too much stays, and so does the only path to an output. tau is never dropped.
    Neither is one without which a stable model turns unstable: responses alone cannot tell a lag from an
    unstable pole with less delay, but the rover that gave them was stable.
    """
    best, steps, kept = start, [], {"tau"}
    while (worst := _worst(best, kept)) is not None:
        estimate, reason = worst
        without = best.structure.fixed(estimate.name, 0.0)
        if silent(without, conditions):
            kept.add(estimate.name)
            continue
        trial = fit(without, conditions)
        unstable = _stable(best, conditions) and not _stable(trial, conditions)
        dropped = trial.average <= best.average * (1 + COST_RISE) + 1.0 and not unstable
        steps.append(ReductionStep(estimate.name, reason, best.average, trial.average, dropped, unstable))
        if dropped:
            best = trial
        else:
            kept.add(estimate.name)
    return best, tuple(steps)


def _stable(result: FitResult, conditions: Sequence[Condition]) -> bool:
    """No pole right of the axis at any speed; one at 0, as in the printed Table 4, is none."""
    poles = np.concatenate([result.structure.poles(c.speed) for c in conditions])
    return bool(np.max(poles.real) < MARGIN)


def _worst(result: FitResult, kept: set[str]) -> tuple[Estimate, str] | None:
    free = [e for e in result.estimates if e.free and e.name not in kept]
    insensitive = [e for e in free if (e.insensitivity_percent or 0.0) > INSENSITIVITY_LIMIT]
    if insensitive:
        e = max(insensitive, key=lambda e: e.insensitivity_percent or 0.0)
        return e, f"insensitivity {e.insensitivity_percent:.3g} % > {INSENSITIVITY_LIMIT:g} %"
    uncertain = [e for e in free if (e.cr_percent or 0.0) > CRAMER_RAO_LIMIT]
    if uncertain:
        e = max(uncertain, key=lambda e: e.cr_percent or 0.0)
        return e, f"Cramer-Rao bound {e.cr_percent:.3g} % > {CRAMER_RAO_LIMIT:g} %"
    return None
