"""The unknown as a model: the curves of `law_search` in the result and in the augmented model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rover_sweep.diagnosis.held_out.worth import HeldOutRun
from rover_sweep.diagnosis.problem.least_squares import Fitted, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import LawCurve, LawHeldOut, Unknown
from rover_sweep.diagnosis.search.rounds import Round
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.unexplained.curve_fit import curves
from rover_sweep.diagnosis.unexplained.input_place import input_places
from rover_sweep.diagnosis.unexplained.law_search import FoundLaws, find_laws
from rover_sweep.diagnosis.unexplained.law_words import could_be, law_sentence, next_run, place_words
from rover_sweep.diagnosis.unexplained.transfers import transfers

NO_LAW = "no law over one quantity of the motion predicts it on data that did not choose the law"


def with_laws_of(
    left: Unknown, last: Round, held_out: Sequence[HeldOutRun]
) -> tuple[Unknown, FoundLaws | None]:
    """(the unknown with its curves, the laws); a sentence says where no law holds.

    last: round of the final model. held_out: runs that judge the curves.
    """
    if left.channel == "V":
        return replace(left, place="speed"), None
    plain = last.problem.plain
    base = sensitivities(plain, last.closest)
    found = find_laws(plain, base, {h.run.name: h.problem for h in held_out})
    if found is None or not found.holds:
        return _without_law(left, plain, base, found.held_out if found else ()), None
    share = found.share_removed
    first = found.laws[0]
    words = [
        law_sentence(one.law, one.alternatives, share if k + 1 == len(found.laws) else None)
        for k, one in enumerate(found.laws)
    ]
    return (
        replace(
            left,
            sentence="; ".join((left.sentence, *words)),
            law=" + ".join(f"{one.law.place} ~ {one.law.over}" for one in found.laws),
            law_gain=found.laws[0].confirmed if share is None else share,
            place=first.law.place,
            alternatives=first.alternatives,
            curves=_curves(found, last),
            held_out=found.held_out,
            could_be=could_be(first.law),
            next_run=next_run(first.law),
        ),
        found,
    )


def _without_law(left: Unknown, problem: Problem, base: Fitted, judged: tuple[LawHeldOut, ...]) -> Unknown:
    """The unknown with its most likely place, where one input would explain all channels."""
    likely = input_places(problem, transfers(problem.runs, base.structure, base.x), base.rows)
    words = [left.sentence, NO_LAW]
    if likely:
        where = " or ".join(place_words(p) for p in likely)
        words.append(f"it has the pattern of an unmeasured input at {where}")
    place, others = (likely[0], likely[1:]) if likely else ("", ())
    return replace(left, sentence="; ".join(words), place=place, alternatives=others, held_out=judged)


def in_model(model: AugmentedModel, found: FoundLaws) -> AugmentedModel:
    """The model with the laws, and the coordinates that were fitted with them."""
    x = {name: value for name, value in found.fitted.fitted.x.items() if not name.startswith("law")}
    return replace(model, x=x, laws=found.fitted.laws)


def _curves(found: FoundLaws, last: Round) -> tuple[LawCurve, ...]:
    out = []
    shown = curves(last.problem.plain, found.fitted)
    for one, law, (y, half) in zip(found.laws, found.fitted.laws, shown, strict=True):
        out.append(
            LawCurve(
                place=law.place,
                alternatives=one.alternatives,
                over=law.over,
                over_unit=law.over_unit,
                unit=law.unit,
                x=law.x,
                y=tuple(y.tolist()),
                low=tuple((y - half).tolist()),
                high=tuple((y + half).tolist()),
                gain=one.gain,
                times=law.times,
                memory=law.memory,
                size=law.size,
            )
        )
    return tuple(out)
