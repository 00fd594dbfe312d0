"""Thresholds of the score test: a parametric bootstrap of the nominal model on this set of runs.

Where nothing is missing, the residual rows are noise plus the tolerances that every rover has:
e + T a, with e ~ N(0, v I), v the variance of a row (`overdispersion`), T the tolerances' rows and
a ~ N(0, I) (|a| for one-sided ones). With S the signatures of the candidates and P the projection outside
of the nominal model's reach (see `problem.signatures`), the scores are

    z = S^T P (e + T a),   S^T P e ~ N(0, v G),   G = S^T P S

so a draw needs only the Cholesky factor of G, and 1000 draws take milliseconds. The gain in a draw is z_k^2
/ G_kk (only z_k > 0 for a one-sided effect), z^T G^-1 z for several parameters, the largest over
the forms of an effect, and over the runs for a change of ground. That one is searched at n instants too: 2
v ln(n), the growth of the largest of n
chi-squared numbers, is added.

Thresholds: the same quantile of its own gains for every effect, chosen so that in a share `FALSE_ALARMS` of
the draws any effect passes (min-P of Westfall and Young 1993); at least `LEAST`.

Efron and Tibshirani 1993: An Introduction to the Bootstrap, section 6.5 (parametric bootstrap).
Westfall and Young 1993: Resampling-Based Multiple Testing, Wiley.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.signatures import Signature, drawn_amounts
from rover_sweep.diagnosis.search.candidate_fits import INSTANTS, Tangent

DRAWS = 1000
FALSE_ALARMS = 0.03  # share of the draws in which any effect may pass its threshold
LEAST = 9.0  # smallest threshold: three standard deviations of one parameter


@dataclass(frozen=True, eq=False)
class NullDistribution:
    """Gains where nothing is missing: gains {effect: (draws,)}, thresholds {effect: gain}."""

    gains: Mapping[str, Array]
    thresholds: Mapping[str, float]


def null_distribution(
    found: Sequence[Signature],
    tolerances: Sequence[Signature],
    tangent: Tangent,
    overdispersion: float,
    seed: int,
) -> NullDistribution:
    """Gains and thresholds of all effects of the signatures `found`.

    tolerances: signatures at one standard deviation of what every rover has. overdispersion: variance of
    a row, 1 at the noise floor.
    """
    if not found:
        return NullDistribution({}, {})
    random = np.random.default_rng(seed)
    outside = tangent.outside(np.column_stack([s.rows for s in found]))
    gram = outside.T @ outside
    # the small term keeps signatures that are nearly the same from a singular factor
    factor = np.linalg.cholesky(gram + np.diag(1e-9 * np.diag(gram) + 1e-12))
    scores = random.standard_normal((DRAWS, len(found))) @ factor.T * np.sqrt(overdispersion)
    if tolerances:
        amounts = drawn_amounts(random, tolerances, DRAWS)
        scores += amounts @ (np.column_stack([s.rows for s in tolerances]).T @ outside[: tangent.rows])
    gains = {}
    for effect in dict.fromkeys(s.effect for s in found):
        laws = dict.fromkeys(s.law for s in found if s.effect == effect)
        members = [[k for k, s in enumerate(found) if (s.effect, s.law) == (effect, law)] for law in laws]
        gains[effect] = np.max([_gain(scores, gram, of_law, found) for of_law in members], axis=0)
        if effect == "surface_change":  # its signature is at one instant, the search tries several
            gains[effect] = gains[effect] + overdispersion * 2 * np.log(INSTANTS)
    return NullDistribution(gains, _thresholds(gains))


def _gain(scores: Array, gram: Array, members: Sequence[int], signatures: Sequence[Signature]) -> Array:
    """Drop (draws,) of the cost when the members are fitted; for one member per run, of the best run."""
    if signatures[members[0]].effect == "surface_change" and len(members) > 1:
        return np.max([_single(scores[:, k], gram[k, k], True) for k in members], axis=0)
    if len(members) == 1:
        return _single(scores[:, members[0]], gram[members[0], members[0]], signatures[members[0]].signed)
    block = gram[np.ix_(members, members)] + 1e-9 * np.eye(len(members)) * np.max(np.diag(gram))
    part = scores[:, members]
    return np.einsum("ij,ij->i", part, np.linalg.solve(block, part.T).T)


def _single(scores: Array, power: float, signed: bool) -> Array:
    """Drop (draws,) of the cost by one parameter with these scores (draws,)."""
    if power < 1e-9:
        return np.zeros(scores.shape)
    return (scores if signed else np.maximum(scores, 0.0)) ** 2 / power


def _thresholds(gains: Mapping[str, Array]) -> dict[str, float]:
    """{effect: gain} at the common quantile that a share `FALSE_ALARMS` of the draws passes somewhere."""
    names = list(gains)
    table = np.column_stack([gains[n] for n in names])
    ranks = np.argsort(np.argsort(table, axis=0), axis=0)
    highest = np.sort(np.max(ranks, axis=1))
    rank = int(highest[int((1.0 - FALSE_ALARMS) * (len(highest) - 1))])
    ordered = np.sort(table, axis=0)
    return {n: float(max(ordered[min(rank, len(highest) - 1), k], LEAST)) for k, n in enumerate(names)}
