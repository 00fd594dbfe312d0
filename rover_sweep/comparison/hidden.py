"""How much each quantity and effect could still differ between simulation and recordings, at 95 %."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rover_sweep.comparison.common_model import FittedSide
from rover_sweep.comparison.differences import Found
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import EffectParameter
from rover_sweep.diagnosis.problem.signatures import Signature, signatures
from rover_sweep.diagnosis.result import UpperBound
from rover_sweep.diagnosis.search.candidate_fits import tangent
from rover_sweep.diagnosis.simulation.candidates import possible

ONE_SIDED = 1.645
CLEAR = 30.0  # chi-squared of a difference; by chance rarer than 1 in 100 000 for 40 parameters
NEARLY, MOST = 0.3, 3  # share of the clearest one's chi-squared, and number, of suspects that are fitted
FAINT = 1e-3  # length of a signature that no data show


def could_differ(
    found: Found, recordings: FittedSide, simulation: FittedSide
) -> dict[str, dict[str, UpperBound]]:
    """{quantity or effect: {parameter: range of recordings minus simulation}}; of some numbers relative."""
    out = {
        q.name: _of_quantity(found, k)
        for k, q in enumerate(found.candidates)
        if q.effect is None and k not in found.chosen
    }
    return {**out, **_of_effects(recordings, simulation)}


def _of_quantity(found: Found, k: int) -> dict[str, UpperBound]:
    q = found.candidates[k]
    amount, sd = found.subsets.amount(k, found.chosen)
    low, high = amount - ONE_SIDED * sd, amount + ONE_SIDED * sd
    unit = "relative" if q.relative else next(iter(q.report(found.recordings[0]).values()))[1]
    return {q.name: UpperBound(unit, low, high, q.matters)}


def _of_effects(recordings: FittedSide, simulation: FittedSide) -> dict[str, dict[str, UpperBound]]:
    one, two = _amounts(recordings), _amounts(simulation)
    out: dict[str, dict[str, UpperBound]] = {}
    for key in one.keys() & two.keys():
        effect, parameter = key
        (p, a, va), (_, b, vb) = one[key], two[key]
        sd = float(np.sqrt(va + vb))
        out.setdefault(effect, {})[parameter] = _bound(p, a - b - ONE_SIDED * sd, a - b + ONE_SIDED * sd)
    return dict(sorted(out.items()))


def largest_score(side: FittedSide) -> float:
    """The largest drop of chi-squared that an effect outside the model predicts, to first order."""
    return max((a * a / v for _, a, v in _amounts(side).values()), default=0.0)


def suspects(recordings: FittedSide, simulation: FittedSide) -> tuple[str, ...]:
    """Effects outside of the model in which both sides differ clearly, those nearly as clear as the first.

    A straight line tells play from sticking poorly, so the fits decide between them.
    """
    one, two = _amounts(recordings), _amounts(simulation)
    clear = {
        key: (one[key][1] - two[key][1]) ** 2 / (one[key][2] + two[key][2]) for key in one.keys() & two.keys()
    }
    ranked = sorted(clear, key=lambda key: -clear[key])
    enough = max(CLEAR, NEARLY * clear[ranked[0]]) if ranked else 0.0
    return tuple(dict.fromkeys(effect for effect, p in ranked if clear[effect, p] > enough))[:MOST]


def _amounts(side: FittedSide) -> Mapping[tuple[str, str], tuple[EffectParameter, float, float]]:
    """{(effect, parameter): (parameter, coordinate, its variance)} of the effects that the model lacks."""
    runs = side.plain.runs
    effects = [e for e in possible(side.model, runs)[0] if not e.in_one_run]
    problem = side.problem
    space = tangent(side.fitted)
    found = signatures(problem, side.fitted, side.model, effects)
    parameters = {(e.id, p.name): p for e in effects for p in e.parameters if not p.nominal}
    left = space.outside(side.fitted.rows)
    out = {}
    for s in found:
        if (s.effect, s.parameter) in parameters and (
            a := _amount(s, space.outside(s.rows), left, side.fitted.overdispersion)
        ):
            out[s.effect, s.parameter] = (parameters[s.effect, s.parameter], *a)
    return out


def _amount(s: Signature, rows: Array, left: Array, variance: float) -> tuple[float, float] | None:
    """(coordinate that the residual shows, its variance); None where the runs hardly show the effect."""
    power = float(rows @ rows)
    if power < FAINT:
        return None
    return s.size * float(rows @ left) / power, s.size**2 * variance / power


def _bound(p: EffectParameter, low: float, high: float) -> UpperBound:
    """A range of coordinates as a bound; of a limit or cut-off its value where the other side has none."""
    if p.form == "inverse":
        farthest = max(abs(low), abs(high))
        return UpperBound(p.unit, p.value(farthest), None)
    return UpperBound(p.unit, low, high)
