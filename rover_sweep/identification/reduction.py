"""Model structure reduction as Tischler & Remple 2012 do it: drop, re-converge, keep if J hardly rises.

A derivative of a lumped model is dropped by setting it to zero. A physical parameter is not: it is fixed
at what the vehicle file says of it, as the paper's authors fixed Ixx and h (section 6.2) and Ixz.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from rover_sweep.identification.cost import Condition
from rover_sweep.identification.fit import Estimate, FitResult, fit, has_zero_response, is_stable

INSENSITIVITY_LIMIT = 10.0  # percent
CRAMER_RAO_LIMIT = 20.0  # percent
COST_RISE = 0.05  # of J_ave, plus one unit of J: what a dropped parameter may cost


@dataclass(frozen=True)
class ReductionStep:
    """One attempt: the parameter, why it was tried, J_ave before and after, whether the drop was kept.

    unstable: kept because the model, stable before, was unstable without it. value: what the parameter
    was fixed at, 0 or the vehicle file's value; found: what the fit had found.
    """

    parameter: str
    reason: str
    before: float
    after: float
    dropped: bool
    unstable: bool = False
    value: float = 0.0
    found: float = 0.0


def reduce(
    start: FitResult,
    conditions: Sequence[Condition],
    known: Mapping[str, float] | None = None,
    keep: Collection[str] = (),
) -> tuple[FitResult, tuple[ReductionStep, ...]]:
    """Drops the worst parameter, one at a time, while J_ave hardly rises.

    First the worst insensitivity above 10 %, then the worst Cramer-Rao bound above 20 %. A parameter
    whose loss costs too much stays, and so does the only path to an output. Delays are never dropped.
    Neither is one without which a stable model turns unstable: responses alone cannot tell a lag from an
    unstable pole with less delay, but the rover that gave them was stable.
    known: the parameters that may be dropped, each fixed at its value; None: all, at zero. keep: never.
    """
    best, steps = start, []
    names = [p.name for p in start.structure.free]
    kept = {*start.structure.delays, *keep, *(n for n in names if known is not None and n not in known)}
    while (worst := _worst(best, kept)) is not None:
        estimate, reason = worst
        value = 0.0 if known is None else known[estimate.name]
        without = best.structure.fixed(estimate.name, value)
        if has_zero_response(without, conditions):
            kept.add(estimate.name)
            continue
        before = is_stable(best.structure, conditions)
        trial = fit(without, conditions, stable=before)
        unstable = before and not is_stable(trial.structure, conditions)
        dropped = trial.average <= best.average * (1 + COST_RISE) + 1.0 and not unstable
        steps.append(
            ReductionStep(
                estimate.name, reason, best.average, trial.average, dropped, unstable, value, estimate.value
            )
        )
        if dropped:
            best = trial
        else:
            kept.add(estimate.name)
    return best, tuple(steps)


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
