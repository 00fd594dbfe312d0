"""What the answer's model leaves: a channel above the noise or something unnamed, its place and curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.held_out.worth import HeldOutRun
from rover_sweep.diagnosis.posterior.infer import Inference
from rover_sweep.diagnosis.posterior.model_fit import ModelFit
from rover_sweep.diagnosis.posterior.transfers import transfers
from rover_sweep.diagnosis.posterior.unnamed import UnnamedFamily
from rover_sweep.diagnosis.result import LawCurve, Unknown
from rover_sweep.diagnosis.simulation.augmented import AugmentedModel
from rover_sweep.diagnosis.simulation.table_law import TableLaw
from rover_sweep.diagnosis.unexplained.input_place import input_places
from rover_sweep.diagnosis.unexplained.law_search import FoundLaw, FoundLaws, drawn_laws, find_laws
from rover_sweep.diagnosis.unexplained.law_words import (
    could_be,
    laws_sentence,
    next_run,
    over_words,
    place_words,
    short,
)
from rover_sweep.diagnosis.verdict import NOTABLE

DRAWN = 200  # laws for a band
GAINS = (0.3, 20.0)  # Hz, of a resonator's curve
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


def with_laws_of(
    left: Unknown, last: ModelFit, held_out: Sequence[HeldOutRun], known: Sequence[UnnamedFamily] = ()
) -> tuple[Unknown, FoundLaws | None]:
    """(the unknown with its place and curves, the laws); a sentence says where none holds.

    last: the model of the answer. held_out: runs that judge the laws. known: see `find_laws`.
    """
    if left.channel == "V":
        return replace(left, place="speed"), None
    found = find_laws(last, {h.run.name: h.problem for h in held_out}, known)
    if found is None:
        return _without_law(left, last), None
    laws, first = [one.at(found.fitted.x) for one in found.laws], found.laws[0]
    holds = found.holds
    words = laws_sentence(laws, first.alternatives, found.share_removed, holds)
    return (
        replace(
            left,
            sentence=f"{left.sentence}; {words}",
            depends_on=", ".join(dict.fromkeys(over_words(law) for law in laws)),
            law="; ".join(map(short, laws)) if holds else "",
            law_gain=found.share_removed if holds else None,
            place=first.law.place,
            alternatives=first.alternatives,
            curves=tuple(_curve(found, one) for one in found.laws) if holds else (),
            held_out=found.held_out,
            could_be=could_be(laws[0]),
            next_run=next_run(laws[0]),
        ),
        found if holds else None,
    )


def _without_law(left: Unknown, last: ModelFit) -> Unknown:
    """The unknown with the place where one unmeasured input explains most."""
    plain, near = last.problem.plain, last.closest
    likely = input_places(plain, transfers(plain.runs, near.structure, near.x), near.rows)
    at = " or ".join(place_words(p) for p in likely)
    why = f"it has the pattern of an unmeasured input at {at}" if likely else NO_LAW
    return replace(
        left, sentence=f"{left.sentence}; {why}", place=likely[0] if likely else "", alternatives=likely[1:]
    )


def in_model(model: AugmentedModel, found: FoundLaws) -> AugmentedModel:
    """The model with the laws, and the coordinates that were fitted with them."""
    x = {name: value for name, value in found.fitted.x.items() if not name.startswith("law")}
    return replace(model, x=x, laws=tuple(one.at(found.fitted.x) for one in found.laws))


def _curve(found: FoundLaws, one: FoundLaw) -> LawCurve:
    """The law with its 90 % band, or a resonator's gain."""
    law = one.at(found.fitted.x)
    resonates = law.memory == "resonance"
    x = np.array(law.x)
    if resonates:
        x = np.sort(np.concatenate((np.geomspace(*GAINS, 40), law.size * np.linspace(0.7, 1.4, 21))))
    shown = _gain if resonates else _table
    drawn = [shown(some, x) for some in drawn_laws(found, one, DRAWN, seed=1)]
    low, high = np.quantile(drawn, (0.05, 0.95), axis=0)
    return LawCurve(
        place=law.place,
        alternatives=one.alternatives,
        over=law.over,
        over_unit="Hz" if resonates else law.over_unit,
        unit=f"{law.unit} per {law.over_unit}" if resonates else law.unit,
        x=tuple(x.tolist()),
        y=tuple(shown(law, x).tolist()),
        low=tuple(low.tolist()),
        high=tuple(high.tolist()),
        gain=one.gain,
        times=law.times,
        memory=law.memory,
        size=law.size,
        damping=law.damping,
    )


def _table(law: TableLaw, x: Array) -> Array:
    """The points (n,) relative to the value at x = 0, or to the mean where the range does not hold 0: a
    constant is not separable from trim, biases and stiffness."""
    y = np.array(law.y)
    return np.asarray(y - (law.at(np.zeros(1))[0] if x[0] < 0.0 < x[-1] else y.mean()))


def _gain(law: TableLaw, f: Array) -> Array:
    """Magnitude (n,) of the resonator's response at f (n,) [Hz]."""
    s = 1j * f / law.size
    return np.asarray(np.abs((law.y[0] + law.y[1] * s) / (1.0 + 2.0 * law.damping * s + s * s)))
