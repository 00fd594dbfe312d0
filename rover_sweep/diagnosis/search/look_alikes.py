"""Look-alikes: effects that explain the residual nearly as well as the best one, and are not excluded.

Test of another effect B against the best one A: if B were the truth, with the amount fitted, how often would
A gain at least as much more than B as it did? The gains are the squared projections of B's signal with noise
and tolerances on the directions of A and B. B is excluded where that share is below `EXCLUDED` and the gains
differ by more than `MODEL_ERROR` (a parametric bootstrap of the test of Cox 1961).

Cox 1961: Tests of separate families of hypotheses, Proc. 4th Berkeley Symposium, vol. 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.signatures import Signature, columns, drawn_amounts
from rover_sweep.diagnosis.search.candidate_fits import Tangent, Trial

DRAWS = 1000
EXCLUDED = 0.02  # share of the draws, below which an effect cannot be the truth
MODEL_ERROR = 0.06  # of the gain; no model is exact, so a smaller difference decides nothing
MOST_NAMED = 2  # look-alikes that a finding lists


@dataclass(frozen=True)
class LookAlike:
    """An effect that is not excluded; cosine of both signals after refitting the nominal model."""

    effect: str
    cosine: float
    gain: float


def find_look_alikes(
    base: Fitted,
    best: Trial,
    others: Sequence[Trial],
    tangent: Tangent,
    tolerances: Sequence[Signature],
    overdispersion: float,
    seed: int,
) -> tuple[LookAlike, ...]:
    """The other trials from the same base that the data do not exclude, the largest gain first.

    tolerances: signatures that every rover has. overdispersion: variance of a row.
    """
    random = np.random.default_rng(seed)
    best_signal = tangent.outside(base.rows - best.fitted.rows)
    scale = float(np.linalg.norm(best_signal)) or 1.0
    size = base.rows.size
    nuisance = tangent.outside(columns(tolerances, size)) if tolerances else np.zeros((best_signal.size, 1))
    out = []
    for other in others:
        if other.effect == best.effect or other.gain < 0.2 * best.gain:
            continue
        signal = tangent.outside(base.rows - other.fitted.rows)
        length = float(np.linalg.norm(signal)) or 1.0
        pair = np.column_stack((best_signal / scale, signal / length))
        cosine = float(pair[:, 0] @ pair[:, 1])
        drawn = _projections(pair, signal, nuisance, tolerances, overdispersion, random)
        difference = drawn[:, 0] ** 2 - drawn[:, 1] ** 2
        ahead = best.gain - other.gain
        share = float(np.mean(difference >= ahead))
        if share >= EXCLUDED or ahead <= MODEL_ERROR * best.gain:
            out.append(LookAlike(other.effect, cosine, other.gain))
    return tuple(sorted(out, key=lambda a: -a.gain)[:MOST_NAMED])


def _projections(
    pair: Array,
    signal: Array,
    nuisance: Array,
    tolerances: Sequence[Signature],
    overdispersion: float,
    random: np.random.Generator,
) -> Array:
    """(draws, 2): projections of the other effect's signal with noise and tolerances on both directions."""
    gram = pair.T @ pair
    factor = np.linalg.cholesky(gram + 1e-9 * np.eye(2))
    noise = random.standard_normal((DRAWS, 2)) @ factor.T * np.sqrt(overdispersion)
    found = signal @ pair + noise
    return found + drawn_amounts(random, tolerances, DRAWS) @ (nuisance.T @ pair) if tolerances else found
