"""What each effect adds to the rows of a fitted model: the score test, and the tiny effects of any rover."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.simulation.candidates import WHOLE, Model
from rover_sweep.diagnosis.simulation.simulator import Structure


@dataclass(frozen=True, eq=False)
class Signature:
    """One parameter of one effect: the rows (size,) that `size` of its coordinate adds."""

    effect: str
    parameter: str
    size: float
    signed: bool
    rows: Array


def signatures(
    problem: Problem,
    base: Fitted,
    model: Model,
    effects: Sequence[Effect],
    at: Mapping[str, float] | None = None,
    tolerances: bool = False,
) -> list[Signature]:
    """Signatures of effects beside a fitted model.

    at: {coordinate name: size}, plain sizes where it is silent; tiny: at their tiny size, only those that
    have one.
    """
    now = problem.model(model.structure, base.x)
    wanted = [
        w
        for e in effects
        if e.id not in WHOLE
        for w in _wanted(problem, base, model, e, at or {}, tolerances)
    ]
    rows = [problem.model(structure, x) - now for _, _, _, structure, x in wanted]
    return [
        Signature(e.id, p.name, size, e.signed, r) for (e, p, size, _, _), r in zip(wanted, rows, strict=True)
    ]


def _wanted(
    problem: Problem, base: Fitted, model: Model, effect: Effect, at: Mapping[str, float], tolerances: bool
) -> list[tuple[Effect, EffectParameter, float, Structure, dict[str, float]]]:
    out = []
    for run in problem.runs if effect.in_one_run else problem.runs[:1]:
        where = run.name if effect.in_one_run else ""
        structure = model.with_effect(effect.id, where).structure
        for p in effect.parameters:
            name = effect.coordinate_name(p)
            size = p.tolerance if tolerances else at.get(name, p.size)
            if p.name == "t" or size == 0.0 or (tolerances and p.nominal):
                continue
            x = {**base.x, name: base.x.get(name, 0.0) + size}
            if effect.in_one_run:
                x[effect.key("t")] = at.get(effect.key("t"), 0.5 * float(run.t[-1]))
            out.append((effect, p, size, structure, x))
    return out


def columns(found: Sequence[Signature], size: int) -> Array:
    """Their rows side by side, (size, k)."""
    return np.column_stack([s.rows for s in found]) if found else np.zeros((size, 1))


def drawn_amounts(random: np.random.Generator, tolerances: Sequence[Signature], draws: int) -> Array:
    """(draws, k): how much of each tiny effect an ordinary rover has, in its standard deviations."""
    amounts = random.standard_normal((draws, len(tolerances)))
    return np.where([s.signed for s in tolerances], amounts, np.abs(amounts)) if tolerances else amounts
