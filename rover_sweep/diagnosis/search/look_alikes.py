"""Which effects would explain the residual as well: could this other one be the truth and look so?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.signatures import Signature, columns, drawn_amounts
from rover_sweep.diagnosis.search.candidate_fits import Tangent, Trial

DRAWS = 1000
EXCLUDED = 0.02  # an effect is excluded where, being the truth, it would look so in fewer draws
MODEL_ERROR = 0.03  # of the gain: no model is exact, so gains that near each other decide nothing
MOST_NAMED = 2  # look-alikes that a finding names


@dataclass(frozen=True)
class LookAlike:
    """An effect that is not excluded; cosine of what both explain, after refitting the nominal model."""

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
    """The other trials beside the same base that the data do not exclude, the most like first."""
    random = np.random.default_rng(seed)
    mine = tangent.outside(base.rows - best.fitted.rows)
    scale = float(np.linalg.norm(mine)) or 1.0
    nuisance = (
        tangent.outside(columns(tolerances, base.rows.size)) if tolerances else np.zeros((mine.size, 1))
    )
    out = []
    for other in others:
        if other.effect == best.effect or other.gain < 0.2 * best.gain:
            continue
        signal = tangent.outside(base.rows - other.fitted.rows)
        length = float(np.linalg.norm(signal)) or 1.0
        pair = np.column_stack((mine / scale, signal / length))
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
    """(draws, 2): projections on both directions of the other effect's signal, noise and nuisances."""
    gram = pair.T @ pair
    factor = np.linalg.cholesky(gram + 1e-9 * np.eye(2))
    noise = random.standard_normal((DRAWS, 2)) @ factor.T * np.sqrt(overdispersion)
    seen = signal @ pair + noise
    return seen + drawn_amounts(random, tolerances, DRAWS) @ (nuisance.T @ pair) if tolerances else seen
