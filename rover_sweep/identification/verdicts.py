"""Verdicts on fits by the guidelines on J, CR and insensitivity (Tischler & Remple 2012, chapters 11, 12)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from rover_sweep.identification.fit import Condition, Estimate, FitResult, fit, has_zero_response, is_stable
from rover_sweep.identification.verify import Verification

Level = Literal["good", "acceptable", "poor", "not identifiable"]
LEVELS: tuple[Level, ...] = get_args(Level)  # the best first
J_GOOD, J_ACCEPTABLE = 50.0, 100.0
CR_GUIDE, I_GUIDE = 20.0, 10.0  # percent
J_RMS_GUIDE, TIC_GUIDE = 2.0, 0.35  # of the paper: above one of them a model does not predict the run
SAME = 0.02  # relative difference of parameters up to which two minima are one
CR_LIMIT, I_LIMIT = 60.0, 25.0  # percent: above these a parameter is not identifiable


@dataclass(frozen=True)
class ModelVerdict:
    """level, and its reasons as sentences, most important first."""

    level: Level
    sentences: tuple[str, ...]


CANNOT = "cannot be identified: "


def judge_model(
    result: FitResult, physical: bool = True, verification: Sequence[Verification] = ()
) -> ModelVerdict:
    """The verdict on one fit and on its prediction of runs that were not fitted.

    physical: its parameters are properties of the rover, so one that is not identifiable makes the model not
    identifiable. The derivatives of a lumped model are always correlated, so the rule does not apply to them.
    """
    lost = [
        e
        for e in result.estimates
        if e.free and e.name not in result.structure.delays and _is_not_identifiable(e)
    ]
    uncertain = [e for e in result.estimates if e.free and _is_uncertain(e) and not (physical and e in lost)]
    failed = [v for v in verification if not (v.tic <= TIC_GUIDE and v.j_rms <= J_RMS_GUIDE)]
    ended = [e for e in result.estimates if e.at_bound]
    reasons = [
        f"does not predict {v.run}, with TIC {v.tic:.2f} (guideline <= {TIC_GUIDE:g}) and "
        f"J_rms {v.j_rms:.3g} (<= {J_RMS_GUIDE:g})"
        for v in failed
    ]
    if ended:
        values = ", ".join(f"{e.name} {e.value:.3g} {e.unit}" for e in ended)
        reasons.append(f"{values} at the bound of the fit's range, so not a result")
    average = result.average
    level: Level = "good" if average <= J_GOOD else "acceptable" if average <= J_ACCEPTABLE else "poor"
    words = {
        "good": f"hardly distinguishable from the data (guideline <= {J_GOOD:g})",
        "acceptable": f"acceptable (guideline <= {J_ACCEPTABLE:g})",
        "poor": f"a poor fit (guideline <= {J_ACCEPTABLE:g})",
    }
    sentences = [*reasons, f"J_ave {average:.1f}, {words[level]}"]
    if uncertain:
        sentences.append("uncertain (above CR 20 % or I 10 %) are " + ", ".join(map(_numbers, uncertain)))
    if lost and not physical:
        sentences.append(
            "valid for prediction at this speed; single derivatives mean little because they are correlated"
        )
    if result.spread > SAME:
        far = f"{100 * result.spread:.0f} %"
        sentences.append(
            f"not unique, since another start reaches the same cost with {result.spread_in} {far} different"
        )
    if result.rivals:
        sentences.append(
            f"{len(result.rivals)} of {result.starts} starts end in another minimum at a higher cost (J_ave "
            f"{result.rivals[0]:.1f} or more); check the starting values and bounds"
        )
    if lost and physical:
        first = CANNOT + ", ".join(map(_numbers, lost))
        return ModelVerdict("not identifiable", (first, *sentences))
    return ModelVerdict("poor" if reasons else level, tuple(sentences))


def _is_not_identifiable(e: Estimate) -> bool:
    return e.at_bound or (e.cr_percent or 0.0) > CR_LIMIT or (e.insensitivity_percent or 0.0) > I_LIMIT


def _is_uncertain(e: Estimate) -> bool:
    """True above a guideline in percent of the value, which says nothing of a value of 0."""
    return e.value != 0.0 and ((e.cr_percent or 0.0) > CR_GUIDE or (e.insensitivity_percent or 0.0) > I_GUIDE)


def _numbers(e: Estimate) -> str:
    bound = ", at its bound" if e.at_bound else ""
    return f"{e.name} (CR {e.cr_percent:.3g} %, I {e.insensitivity_percent:.3g} %{bound})"


def kinematic_suffices(costs: Mapping[str, Mapping[str, float]]) -> str | None:
    """A sentence on why tyre parameters cannot be identified, or None. costs: {model: {response: J}}.

    When the kinematic model fits r and a_y as well as the bicycle, the stiffness may be infinite: its value
    only reflects noise and delay. Two models that both fit badly allow no conclusion.
    """
    plain, tyres = costs.get("kinematic"), costs.get("bicycle") or costs.get("roll-yaw")
    if plain is None or tyres is None:
        return None
    shared = [o for o in ("r", "ay") if o in plain and o in tyres]
    without, with_tyres = (sum(c[o] for o in shared) / len(shared) for c in (plain, tyres))
    if without > with_tyres * 1.1 + 2.0 or without > J_ACCEPTABLE:
        return None
    return (
        f"the kinematic model fits as well (J of {' and '.join(shared)} {without:.1f}, "
        f"{with_tyres:.1f} with tyres), so tyre stiffness and yaw inertia cannot be identified "
        "from these runs"
    )


# Model structure reduction (Tischler & Remple 2012, chapter 12): drop a parameter, refit, compare J.
#
# A derivative of a lumped model is dropped by setting it to zero. A physical parameter is fixed at its value
# in the vehicle file, as the paper fixes Ixx and h (section 6.2) and Ixz.


COST_RISE = 0.05  # of J_ave, plus one unit of J: most that a dropped parameter may add


@dataclass(frozen=True)
class ReductionStep:
    """One attempt to drop a parameter; before, after: J_ave; reason: why it was tried.

    dropped: the drop was accepted. unstable: rejected because the model was stable before and unstable after.
    value: fixed at, 0 or from the vehicle file; found: the fitted value, both in its unit.
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

    Worst: the largest insensitivity above 10 %, then the largest Cramer-Rao bound above 20 %. Never
    dropped: delays, and a parameter whose loss zeroes a response or makes a stable model unstable. The
    responses cannot separate a lag from an unstable pole with another delay; the recorded rover was stable.
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
    for name, symbol, limit in (
        ("insensitivity_percent", "insensitivity", I_GUIDE),
        ("cr_percent", "Cramer-Rao bound", CR_GUIDE),
    ):
        percent = {e.name: getattr(e, name) or 0.0 for e in free}
        if above := [e for e in free if percent[e.name] > limit]:
            e = max(above, key=lambda e: percent[e.name])
            return e, f"{symbol} {percent[e.name]:.3g} % > {limit:g} %"
    return None
