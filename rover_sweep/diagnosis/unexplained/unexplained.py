"""What the answer's model leaves: a channel above the noise or something unnamed, its place and curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rover_sweep.diagnosis.held_out.worth import HeldOutRun
from rover_sweep.diagnosis.posterior.infer import Inference
from rover_sweep.diagnosis.posterior.model_fit import ModelFit
from rover_sweep.diagnosis.posterior.transfers import transfers
from rover_sweep.diagnosis.posterior.unnamed import UnnamedFamily
from rover_sweep.diagnosis.result import LawCurve, Unknown
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.unexplained.input_place import input_places
from rover_sweep.diagnosis.unexplained.law_search import FoundLaw, curve_of, find_law
from rover_sweep.diagnosis.unexplained.law_words import (
    could_be,
    law_sentence,
    next_run,
    over_words,
    place_words,
)
from rover_sweep.diagnosis.verdict import NOTABLE

NO_LAW = "no law over one quantity of the motion, and no resonance, explains it"
CHANNELS = {
    "r": "the yaw rate",
    "ay": "the lateral acceleration",
    "p": "the roll rate",
    "vy": "the lateral velocity",
}


def left_unexplained(found: Inference, named: bool) -> Unknown | None:
    """The misfit of the final model, None where it is at the noise floor and nothing unnamed is probable.

    named: effects were found.
    """
    misfit = found.last.misfit
    channel = max(misfit, key=lambda c: misfit[c])
    probable = found.posterior.something_else > 0.5
    if misfit[channel] <= NOTABLE and not probable:
        return None
    ratio = float(np.sqrt(misfit[channel]))
    still = "still " if named else ""
    sentence = f"{CHANNELS[channel]} {still}differs from the simulation by {ratio:.2g} times the noise"
    if misfit[channel] <= NOTABLE:
        sure = 100 * found.posterior.something_else
        sentence = f"an effect that is not in the list is missing ({sure:.0f} %)"
    return Unknown(channel, "nothing that was tried", ratio, f"{sentence}; no candidate explains it")


def with_law_of(
    left: Unknown, last: ModelFit, held_out: Sequence[HeldOutRun], known: Sequence[UnnamedFamily] = ()
) -> tuple[Unknown, FoundLaw | None]:
    """(the unknown with its place and curve, the law); a sentence says where no law holds.

    last: the model of the answer. held_out: runs that judge the curve. known: see `find_law`.
    """
    if left.channel == "V":
        return replace(left, place="speed"), None
    found = find_law(last, {h.run.name: h.problem for h in held_out}, known)
    if found is None or not found.holds:
        return _without_curve(left, last, found), None
    words = law_sentence(found.law, found.alternatives, found.share_removed)
    return (
        replace(
            left,
            sentence=f"{left.sentence}; {words}",
            law=f"{found.law.place} ~ {found.law.over}",
            law_gain=found.share_removed,
            place=found.law.place,
            alternatives=found.alternatives,
            curves=(_curve(found, last),),
            held_out=found.held_out,
            could_be=could_be(found.law),
            next_run=next_run(found.law),
        ),
        found,
    )


def _without_curve(left: Unknown, last: ModelFit, found: FoundLaw | None) -> Unknown:
    """The unknown with its most likely place: of a resonance, of a curve that does not hold on held-out runs,
    or where one unmeasured input explains most."""
    if found is not None:
        likely = (found.law.place, *found.alternatives)
        at, over = _either(likely), over_words(found.law)
        why = f"a law that removes too little of the held-out residual acts on {at}, over {over}"
        if found.law.memory == "resonance":
            why = f"a resonance at about {found.law.size:.2g} Hz, driven by {over}, acts on {at}"
        left = replace(left, could_be=could_be(found.law), next_run=next_run(found.law))
    else:
        plain, near = last.problem.plain, last.closest
        likely = input_places(plain, transfers(plain.runs, near.structure, near.x), near.rows)
        why = f"it has the pattern of an unmeasured input at {_either(likely)}" if likely else NO_LAW
    return replace(
        left,
        sentence=f"{left.sentence}; {why}",
        place=likely[0] if likely else "",
        alternatives=likely[1:],
        held_out=found.held_out if found else (),
    )


def _either(places: tuple[str, ...]) -> str:
    return " or ".join(place_words(p) for p in places)


def in_model(model: AugmentedModel, found: FoundLaw) -> AugmentedModel:
    """The model with the law, and the coordinates that were fitted with it."""
    assert found.fitted is not None
    x = {name: value for name, value in found.fitted.x.items() if not name.startswith("law")}
    return replace(model, x=x, laws=(found.law,))


def _curve(found: FoundLaw, last: ModelFit) -> LawCurve:
    assert found.fitted is not None
    law = found.law
    y, half = curve_of(last.problem.plain, law, found.fitted)
    return LawCurve(
        place=law.place,
        alternatives=found.alternatives,
        over=law.over,
        over_unit=law.over_unit,
        unit=law.unit,
        x=law.x,
        y=tuple(y.tolist()),
        low=tuple((y - half).tolist()),
        high=tuple((y + half).tolist()),
        gain=found.gain,
        times=law.times,
        memory=law.memory,
        size=law.size,
    )
