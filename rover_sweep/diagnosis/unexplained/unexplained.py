"""A misfit that no candidate explains: a channel above the noise, or an unnamed term in the residual.

The residual is regressed on the signatures of unnamed terms (`laws`), one term at a time (forward selection,
as in the sparse regression of Brunton, Proctor and Kutz 2016). The fitted terms must predict rows that the
regression did not use. A single term counts where its gain is above the parametric bootstrap, as for a
candidate.

Brunton, Proctor and Kutz 2016: Discovering governing equations from data by sparse identification of
nonlinear dynamical systems, PNAS 113(15).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.least_squares import fit
from rover_sweep.diagnosis.problem.residuals import over_noise
from rover_sweep.diagnosis.problem.signatures import Signature
from rover_sweep.diagnosis.result import THROUGHOUT, Mismatch, Unknown
from rover_sweep.diagnosis.search.rounds import MOST_NOISE, Round
from rover_sweep.diagnosis.search.threshold import null_distribution
from rover_sweep.diagnosis.simulation.nominal import Coordinate
from rover_sweep.diagnosis.unexplained.laws import Law, laws
from rover_sweep.spectra.side_by_side import side_by_side

PREDICTS = 0.3  # share of the residual above the floor that the terms must predict in the other rows
BLOCK = 8  # lines that are used, or held out, together
CHANNELS = {
    "r": "the yaw rate",
    "ay": "the lateral acceleration",
    "p": "the roll rate",
    "vy": "the lateral velocity",
}
FITTED = 3  # terms with the largest predicted gains, which are fitted
KEPT = 3  # most terms of the regression
ABOVE_CHANCE = 3.5  # gain over threshold; it replaces the material size. 3.0 came up where nothing was hidden
NEW = 1e-3  # least share of a term's signature that the model cannot reach


@dataclass(frozen=True, eq=False)
class _TestedLaws:
    """The unnamed terms that the recordings could show.

    rows (size, k): signatures with unit length outside the model's reach. gains (k,): drop of the cost with
    each term alone; over_chance (k,): that drop over its threshold.
    """

    laws: tuple[Law, ...]
    rows: Array
    gains: Array
    over_chance: Array


def unmodelled_gain(of: Round, seed: int) -> float:
    """Drop of the cost by the unnamed term that explains most, minus its threshold.

    Fitted, since the linear prediction ignores the bounds of the nominal coordinates and so is too large.
    """
    tested = _tested_laws(of, seed)
    best = np.argsort(-tested.gains)[:FITTED]
    return max(
        (_fitted_gain(of, tested.laws[k]) - tested.gains[k] / tested.over_chance[k] for k in best),
        default=0.0,
    )


def _fitted_gain(of: Round, law: Law) -> float:
    structure, amount = of.model.structure, law.effect.parameters[0]
    more = replace(structure, effects=(*structure.effects, law.effect))
    own = Coordinate(law.effect.key(amount.name), 0.0, amount.low, amount.high, amount.size)
    start = {**of.fitted.x, own.name: 0.0}
    return of.fitted.cost - fit(of.problem, more, (*of.model.free, own), start, known=of.fitted).cost


def left_unexplained(last: Round, named: bool, seed: int, sure: bool = False) -> Unknown | None:
    """The misfit of the final model, None where it is at the noise floor.

    named: effects were found. Small remainders are then errors of their equations and are not reported.
    sure: an unnamed term is known to explain the residual.
    """
    notable = {c: misfit.level for c, misfit in last.misfit.items() if misfit.notable}
    if named and not notable:
        return None
    tested = _tested_laws(last, seed)
    if notable:
        found = _notable(last, tested, notable)
        noise = named and found.law_gain is None and not any(m.large for m in last.misfit.values())
        return None if noise else found
    if tested.over_chance.size == 0 or (not sure and np.max(tested.over_chance) <= ABOVE_CHANCE):
        return None
    return _follows_one_law(last, tested, int(np.argmax(tested.over_chance)))


def unknown_place(places: Sequence[Mismatch]) -> Unknown | None:
    """The largest misfit under a condition, or in V_y, where no candidate and no unnamed term was found.

    A misfit throughout r, a_y or p may come from normal tolerances.
    """
    conditional = [m for m in places if m.condition != THROUGHOUT or m.channel == "vy"]
    if not conditional:
        return None
    worst = max(conditional, key=lambda m: m.residual_over_noise)
    sentence = f"{worst.sentence}; no candidate explains it"
    return Unknown(worst.channel, worst.condition, worst.residual_over_noise, sentence)


def _notable(last: Round, tested: _TestedLaws, notable: dict[str, float]) -> Unknown:
    channel = max(notable, key=lambda c: notable[c])
    ratio = float(np.sqrt(notable[channel]))
    still = f"{CHANNELS[channel]} still differs from the simulation by {ratio:.1f} times the noise"
    chosen, gain = _regression(last, tested)
    if gain < PREDICTS:
        return Unknown(
            channel,
            "nothing that was tried",
            ratio,
            f"{still}; no candidate explains it, and no simple function of the state predicts it",
        )
    on = ", ".join(dict.fromkeys(law.on for law in chosen))
    sentence = f"{still}; it depends on {on}, and no candidate explains it"
    return Unknown(channel, on, ratio, sentence, " + ".join(law.term for law in chosen), gain)


def _follows_one_law(last: Round, tested: _TestedLaws, best: int) -> Unknown:
    """One term above chance, where no channel as a whole is above the noise."""
    law, row = tested.laws[best], tested.rows[:, best]
    power = {c: float(np.sum(last.problem.part(row, channel=c) ** 2)) for c in CHANNELS}
    channel = max(power, key=lambda c: power[c])
    ratio = over_noise(float(tested.gains[best]), row)
    over = float(tested.over_chance[best])
    times = f"{over:.1f}" if over < 10 else f"{over:.0f}"
    sentence = (
        f"{CHANNELS[channel]} differs from the simulation by {ratio:.1f} times the noise, as if a term "
        f"{law.on} acted on the {law.place}; its gain is {times} times the threshold, and "
        "no candidate explains it"
    )
    share = _share_predicted(last, tested, [best])
    return Unknown(channel, law.on, ratio, sentence, law.term, share)


def _tested_laws(last: Round, seed: int) -> _TestedLaws:
    structure, problem = last.model.structure, last.problem
    x, every = dict(last.fitted.x), laws()
    now = problem.model(structure, x)

    def signature(law: Law) -> Array:
        more = replace(structure, effects=(*structure.effects, law.effect))
        amount = law.effect.parameters[0]
        return problem.model(more, {**x, law.effect.key(amount.name): amount.size}) - now

    recorded = {r.channel for r in problem.rows}
    every = tuple(w for w in every if not w.place.startswith("sensor") or w.place.split()[-1] in recorded)
    rows = list(side_by_side(signature, every))
    kept: list[tuple[Law, Array, Array]] = []
    for law, row in zip(every, rows, strict=True):
        outside = last.tangent.outside(row)
        power = float(outside @ outside)
        if power > max(NEW * float(row @ row), 1e-12):
            size = 1.0 / np.sqrt(power)
            kept.append((law, row * size, outside * size))
    found = [Signature(law.effect.id, "amount", 1.0, True, row) for law, row, _ in kept]
    chance = null_distribution(
        found, last.tolerances, last.tangent, min(last.fitted.overdispersion, MOST_NOISE), seed
    )
    left = last.tangent.outside(last.fitted.rows)
    gains = np.array([float(o @ left) ** 2 for _, _, o in kept])
    needed = np.array([chance.thresholds[law.effect.id] for law, _, _ in kept])
    table = np.column_stack([o[: problem.size] for _, _, o in kept]) if kept else np.zeros((problem.size, 0))
    return _TestedLaws(tuple(law for law, _, _ in kept), table, gains, gains / needed)


def _regression(last: Round, tested: _TestedLaws) -> tuple[list[Law], float]:
    """(terms selected on the used rows, share of the held-out residual above the floor they predict)."""
    target, test = last.fitted.rows, _held_out_rows(last)
    terms = tested.rows
    size = np.linalg.norm(terms[~test], axis=0) + 1e-12
    left, chosen = target[~test], list[int]()
    while len(chosen) < min(KEPT, len(tested.laws)):
        scores = np.abs(terms[~test].T @ left) / size
        scores[chosen] = -1.0
        chosen.append(int(np.argmax(scores)))
        amounts = np.linalg.lstsq(terms[~test][:, chosen], target[~test], rcond=None)[0]
        left = target[~test] - terms[~test][:, chosen] @ amounts
    return [tested.laws[k] for k in chosen], _share_predicted(last, tested, chosen)


def _share_predicted(last: Round, tested: _TestedLaws, chosen: Sequence[int]) -> float:
    """Share of the held-out residual above the floor that terms fitted to the other rows predict."""
    target, test = last.fitted.rows, _held_out_rows(last)
    terms = tested.rows[:, list(chosen)]
    amounts = np.linalg.lstsq(terms[~test], target[~test], rcond=None)[0]
    before, after = (float(np.sum(y**2)) for y in (target[test], target[test] - terms[test] @ amounts))
    above = before - float(test.sum())
    return (before - after) / above if above > 0.1 * test.sum() else 0.0


def _held_out_rows(last: Round) -> NDArray[np.bool_]:
    """Rows (size,) held out of a regression: the last run, or every other block of lines of a single run."""
    out = np.zeros(last.problem.size, bool)
    runs = {r.run for r in last.problem.rows}
    for r in last.problem.rows:
        if len(runs) > 1:
            out[r.start : r.start + r.size] = r.run == max(runs)
        else:  # whole blocks, since the taper correlates neighbouring lines
            out[r.start : r.start + r.size] = np.tile(np.arange(r.bins.size) // BLOCK % 2 == 1, 2)
    return out
