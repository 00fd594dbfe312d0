"""The unknown as a model: the curves of `law_search` in the result and in the augmented model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rover_sweep.diagnosis.held_out.worth import HeldOutRun
from rover_sweep.diagnosis.problem.least_squares import Fitted, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import LawCurve, Unknown
from rover_sweep.diagnosis.search.rounds import Round
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.unexplained.curve_fit import curves
from rover_sweep.diagnosis.unexplained.input_place import input_places
from rover_sweep.diagnosis.unexplained.law_search import FoundLaws, find_laws
from rover_sweep.diagnosis.unexplained.law_words import (
    could_be,
    further_law_sentence,
    law_sentence,
    next_run,
    over_words,
    place_words,
)
from rover_sweep.diagnosis.unexplained.transfers import transfers

TOO_WEAK = "but removes too little of the held-out residual"
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
        return _without_law(left, plain, base, found), None
    share = found.share_removed
    first = found.laws[0]
    words = [law_sentence(first.law, first.alternatives, share)]
    words += [further_law_sentence(one.law) for one in found.laws[1:]]
    misfit = left.sentence.partition(";")[0]  # without what simple terms say, or that none predicts it
    return (
        replace(
            left,
            sentence="; ".join((misfit, "no candidate explains it", *words)),
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


def _without_law(left: Unknown, problem: Problem, base: Fitted, weak: FoundLaws | None) -> Unknown:
    """The unknown with its most likely place only: that of a weak law, or where one input explains most."""
    if weak and not weak.contradicted:
        law = weak.laws[0].law
        likely = (law.place, *weak.laws[0].alternatives)
        why = f"the best law acts on {_either(likely)}, over {over_words(law)}, {TOO_WEAK}"
    else:
        likely = input_places(problem, transfers(problem.runs, base.structure, base.x), base.rows)
        why = f"it has the pattern of an unmeasured input at {_either(likely)}" if likely else ""
    words = [left.sentence, NO_LAW, why] if why else [left.sentence, NO_LAW]
    return replace(
        left,
        sentence="; ".join(words),
        place=likely[0] if likely else "",
        alternatives=likely[1:],
        held_out=weak.held_out if weak else (),
    )


def _either(places: tuple[str, ...]) -> str:
    return " or ".join(place_words(p) for p in places)


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
