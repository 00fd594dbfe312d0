"""Model structure reduction (Tischler & Remple 2012, chapter 12): drop a parameter, refit, compare J.

A derivative of a lumped model is dropped by setting it to zero. A physical parameter is fixed at its value in
the vehicle file, as the paper fixes Ixx and h (section 6.2) and Ixz.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from rover_sweep.identification.cost import Condition
from rover_sweep.identification.fit import Estimate, FitResult, fit, has_zero_response, is_stable

INSENSITIVITY_LIMIT = 10.0  # percent
CRAMER_RAO_LIMIT = 20.0  # percent
COST_RISE = 0.05  # of J_ave, plus one unit of J: most that a dropped parameter may add


@dataclass(frozen=True)
class ReductionStep:
    """One attempt to drop a parameter; before, after: J_ave; reason: why it was tried.

    dropped: the drop was accepted. unstable: rejected because the model was stable before and unstable after.
    value: at which it was fixed, 0 or that of the vehicle file; found: the fitted one, both in its unit.
    """

    parameter: str
    reason: str
    before: float
    after: float
    dropped: bool
    unstable: bool = False
    value: float = 0.0
    found: float = 0.0


def reduce_model(
    start: FitResult,
    conditions: Sequence[Condition],
    known: Mapping[str, float] | None = None,
    keep: Collection[str] = (),
) -> tuple[FitResult, tuple[ReductionStep, ...]]:
    """Drops one parameter at a time, the worst first, while J_ave rises by no more than 5 % plus 1.

    Worst: the largest insensitivity above 10 %, then the largest Cramer-Rao bound above 20 %. Delays stay,
    and so does a parameter without which a response is zero or a stable model turns unstable: the responses
    cannot separate a lag from an unstable pole with another delay, but the recorded rover was stable.
    known: {parameter that may be dropped: value to fix it at}; None: all, at zero. keep: never dropped.
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
