"""Verdicts on fits by the guidelines on J, CR and insensitivity (Tischler & Remple 2012, chapters 11, 12)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from rover_sweep.identification.fit import Estimate, FitResult
from rover_sweep.identification.verify import Verification

Level = Literal["good", "acceptable", "poor", "not identifiable"]
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
    reasons = [_prediction_sentence(v) for v in failed] + ([_bound_sentence(ended)] if ended else [])
    sentences = [*reasons, _cost_sentence(result.average)]
    if uncertain:
        sentences.append(
            "uncertain, above the guidelines (CR 20 %, I 10 %): " + ", ".join(map(_numbers, uncertain))
        )
    if lost and not physical:
        sentences.append(
            "valid for prediction at this speed; single derivatives mean little because they are correlated"
        )
    sentences += _start_sentences(result)
    if lost and physical:
        first = "cannot be identified: " + ", ".join(map(_numbers, lost))
        return ModelVerdict("not identifiable", (first, *sentences))
    return ModelVerdict("poor" if reasons else _level(result.average), tuple(sentences))


def at_most_acceptable(verdict: ModelVerdict, why: tuple[str, ...]) -> ModelVerdict:
    """The verdict with a level of at most acceptable. why: sentences on doubts that the fit cannot show."""
    return ModelVerdict("acceptable", (*why, *verdict.sentences)) if verdict.level == "good" else verdict


def _prediction_sentence(v: Verification) -> str:
    tic, j_rms = f"TIC {v.tic:.2f} (guideline <= {TIC_GUIDE:g})", f"J_rms {v.j_rms:.3g} (<= {J_RMS_GUIDE:g})"
    return f"does not predict {v.run}: {tic}, {j_rms}"


def _bound_sentence(ended: Sequence[Estimate]) -> str:
    values = ", ".join(f"{e.name} {e.value:.3g} {e.unit}" for e in ended)
    return f"at the bound of what the fit may try, so not a result: {values}"


def _start_sentences(result: FitResult) -> list[str]:
    """Warnings that the result depends on the starting point of the fit."""
    sentences = []
    if result.spread > SAME:
        far = f"{100 * result.spread:.0f} %"
        sentences.append(
            f"not unique: another start reaches the same cost with {result.spread_in} {far} different"
        )
    if result.rivals:
        sentences.append(
            f"{len(result.rivals)} of {result.starts} starts end in another minimum at a higher cost (J_ave "
            f"{result.rivals[0]:.1f} or more): check the starting values and bounds"
        )
    return sentences


def _is_not_identifiable(e: Estimate) -> bool:
    return e.at_bound or (e.cr_percent or 0.0) > CR_LIMIT or (e.insensitivity_percent or 0.0) > I_LIMIT


def _is_uncertain(e: Estimate) -> bool:
    """True above a guideline in percent of the value, which says nothing of a value of 0."""
    return e.value != 0.0 and ((e.cr_percent or 0.0) > CR_GUIDE or (e.insensitivity_percent or 0.0) > I_GUIDE)


def _numbers(e: Estimate) -> str:
    bound = ", at its bound" if e.at_bound else ""
    return f"{e.name} (CR {e.cr_percent:.3g} %, I {e.insensitivity_percent:.3g} %{bound})"


def _level(average: float) -> Level:
    return "good" if average <= J_GOOD else "acceptable" if average <= J_ACCEPTABLE else "poor"


def _cost_sentence(average: float) -> str:
    level = {
        "good": f"hardly distinguishable from the data (guideline <= {J_GOOD:g})",
        "acceptable": f"acceptable (guideline <= {J_ACCEPTABLE:g})",
        "poor": f"a poor fit (guideline <= {J_ACCEPTABLE:g})",
    }[_level(average)]
    return f"J_ave {average:.1f}: {level}"


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
