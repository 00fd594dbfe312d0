"""Parametric bootstrap of the nominal model on this very set of runs, with the nuisances drawn as well.

A draw is the noise of the recordings and a little of every effect, as every rover has; what it projects
on the signature of an effect is what that effect would gain though nothing is hidden. By linear algebra a
thousand draws cost milliseconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.signatures import Signature, drawn_amounts
from rover_sweep.diagnosis.search.candidate_fits import INSTANTS, Tangent

DRAWS = 1000
FALSE_ALARMS = 0.03  # share of the draws in which any effect at all may pass its threshold


@dataclass(frozen=True, eq=False)
class NullDistribution:
    """What effects gain where nothing is hidden: gains {effect: (draws,)}, thresholds {effect: gain}."""

    gains: Mapping[str, Array]
    thresholds: Mapping[str, float]


def null_distribution(
    found: Sequence[Signature], tiny: Sequence[Signature], tangent: Tangent, overdispersion: float, seed: int
) -> NullDistribution:
    """Gains and thresholds of all effects of the signatures `found`.

    tiny: signatures at one standard deviation of an ordinary rover. overdispersion: variance of a row.
    """
    if not found:
        return NullDistribution({}, {})
    random = np.random.default_rng(seed)
    outside = tangent.outside(np.column_stack([s.rows for s in found]))
    gram = outside.T @ outside
    # noise counts only in the span of the signatures, where it is N(0, overdispersion * gram)
    factor = np.linalg.cholesky(gram + np.diag(1e-9 * np.diag(gram) + 1e-12))
    seen = random.standard_normal((DRAWS, len(found))) @ factor.T * np.sqrt(overdispersion)
    if tiny:
        amounts = drawn_amounts(random, tiny, DRAWS)
        seen += amounts @ (np.column_stack([s.rows for s in tiny]).T @ outside[: tangent.rows])
    gains = {}
    for effect in dict.fromkeys(s.effect for s in found):
        members = [k for k, s in enumerate(found) if s.effect == effect]
        gains[effect] = _gain(seen, gram, members, found)
        if effect == "surface_change":  # signed at one instant of each run, while the search tries several
            gains[effect] = gains[effect] + overdispersion * 2 * np.log(INSTANTS)
    return NullDistribution(gains, _thresholds(gains))


def _gain(seen: Array, gram: Array, members: Sequence[int], signatures: Sequence[Signature]) -> Array:
    """Drop of the cost when the members are fitted: for several in one run each, that of the best."""
    if signatures[members[0]].effect == "surface_change":
        return np.max([_single(seen[:, k], gram[k, k], True) for k in members], axis=0)
    if len(members) == 1:
        return _single(seen[:, members[0]], gram[members[0], members[0]], signatures[members[0]].signed)
    block = gram[np.ix_(members, members)] + 1e-9 * np.eye(len(members)) * np.max(np.diag(gram))
    part = seen[:, members]
    return np.einsum("ij,ij->i", part, np.linalg.solve(block, part.T).T)


def _single(seen: Array, power: float, signed: bool) -> Array:
    if power < 1e-9:
        return np.zeros(seen.shape)
    return (seen if signed else np.maximum(seen, 0.0)) ** 2 / power


def _thresholds(gains: Mapping[str, Array]) -> dict[str, float]:
    """A quantile per effect, the same for all, such that `FALSE_ALARMS` of the draws pass any of them."""
    names = list(gains)
    table = np.column_stack([gains[n] for n in names])
    ranks = np.argsort(np.argsort(table, axis=0), axis=0)
    worst = np.sort(np.max(ranks, axis=1))
    rank = int(worst[int((1.0 - FALSE_ALARMS) * (len(worst) - 1))])
    ordered = np.sort(table, axis=0)
    return {n: float(max(ordered[min(rank, len(worst) - 1), k], 9.0)) for k, n in enumerate(names)}
