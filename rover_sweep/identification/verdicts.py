"""What a fit is worth, in words: the guidelines of Tischler & Remple 2012 on J, CR and insensitivity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from rover_sweep.identification.fit import Estimate, FitResult
from rover_sweep.identification.verify import Verification

Level = Literal["good", "acceptable", "poor", "not identifiable"]
J_GOOD, J_ACCEPTABLE = 50.0, 100.0
CR_GUIDE, I_GUIDE = 20.0, 10.0  # percent
TIC_GUIDE = 0.35  # the paper's: above it a model does not predict the run
SAME = 0.02  # relative difference of parameters up to which two ends are one answer
CR_LOST, I_LOST = 60.0, 25.0  # percent: beyond these the number says nothing about the rover


@dataclass(frozen=True)
class ModelVerdict:
    """level, and the reasons as sentences, the weightiest first."""

    level: Level
    sentences: tuple[str, ...]


def judge_model(
    result: FitResult, physical: bool = True, verification: Sequence[Verification] = ()
) -> ModelVerdict:
    """The verdict on one fit and on how it predicts runs that it has not seen.

    physical: its parameters are properties of the rover, so that one that is lost spoils the model;
    the derivatives of a lumped model are correlated by nature and stand for one another.
    """
    lost = [e for e in result.estimates if e.free and e.name not in result.structure.delays and _is_lost(e)]
    weak = [e for e in result.estimates if e.free and _is_weak(e) and not (physical and e in lost)]
    failed = [v for v in verification if not v.tic <= TIC_GUIDE]
    words = [_prediction_words(v) for v in failed] + [_cost_words(result.average)]
    if weak:
        words.append("uncertain beyond the guidelines (CR 20 %, I 10 %): " + ", ".join(map(_numbers, weak)))
    if lost and not physical:
        words.append(
            "good for predicting this speed; single derivatives mean little, they trade against each other"
        )
    words += _start_words(result)
    if lost and physical:
        first = "cannot be identified: " + ", ".join(map(_numbers, lost))
        return ModelVerdict("not identifiable", (first, *words))
    return ModelVerdict("poor" if failed else _level(result.average), tuple(words))


def not_good(verdict: ModelVerdict, why: tuple[str, ...]) -> ModelVerdict:
    """At most acceptable, for reasons that the fit cannot show; as it was where it is no better anyway."""
    return ModelVerdict("acceptable", (*why, *verdict.sentences)) if verdict.level == "good" else verdict


def _prediction_words(v: Verification) -> str:
    return f"does not predict {v.run}: TIC {v.tic:.2f} (guideline <= {TIC_GUIDE:g}), J_rms {v.j_rms:.3g}"


def _start_words(result: FitResult) -> list[str]:
    """Warnings that the answer hangs on where the fit began."""
    words = []
    if result.spread > SAME:
        far = f"{100 * result.spread:.0f} %"
        words.append(
            f"not the only answer: another start reaches the same cost with {result.spread_in} {far} away"
        )
    if result.rivals:
        words.append(
            f"{len(result.rivals)} of {result.starts} starts end elsewhere at a higher cost (J_ave "
            f"{result.rivals[0]:.1f} and more): check the starting values and bounds"
        )
    return words


def _is_lost(e: Estimate) -> bool:
    return e.at_bound or (e.cr_percent or 0.0) > CR_LOST or (e.insensitivity_percent or 0.0) > I_LOST


def _is_weak(e: Estimate) -> bool:
    return (e.cr_percent or 0.0) > CR_GUIDE or (e.insensitivity_percent or 0.0) > I_GUIDE


def _numbers(e: Estimate) -> str:
    bound = ", at its bound" if e.at_bound else ""
    return f"{e.name} (CR {e.cr_percent:.3g} %, I {e.insensitivity_percent:.3g} %{bound})"


def _level(average: float) -> Level:
    return "good" if average <= J_GOOD else "acceptable" if average <= J_ACCEPTABLE else "poor"


def _cost_words(average: float) -> str:
    level = {
        "good": f"hardly distinguishable from the data (guideline <= {J_GOOD:g})",
        "acceptable": f"acceptable (guideline <= {J_ACCEPTABLE:g})",
        "poor": f"a poor fit (guideline <= {J_ACCEPTABLE:g})",
    }[_level(average)]
    return f"J_ave {average:.1f}: {level}"


def kinematic_suffices(costs: Mapping[str, Mapping[str, float]]) -> str | None:
    """Why tyre parameters mean nothing here, or None; costs: J of each response by model name.

    Where the kinematic model fits r and a_y as well as the bicycle, a stiffness is one that the data
    cannot tell from infinity: soaked-up noise and delay. Two models that both fit badly say nothing.
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
