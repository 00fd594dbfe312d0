"""What differs between two fits of one model: the fewest quantities, with their values on both sides.

With the coordinates x_D and x_S of recordings and simulation, their covariances, and the columns B of the
chosen quantities, both sides are one Gaussian: x_S ~ N(mu, S_S), x_D ~ N(mu + B c, S_D). The estimate of mu
and c by generalised least squares gives both sides' values; 400 draws from its covariance the 90 % intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rover_sweep.comparison.answer import Difference, Kind
from rover_sweep.comparison.common_model import FittedSide
from rover_sweep.comparison.fewest_quantities import PENALTY, Chosen, Subsets, fewest
from rover_sweep.comparison.quantities import Comparable, Values, quantities
from rover_sweep.comparison.sentences import difference_sentence
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.result import EffectValue

DRAWS, LEVEL = 400, (5.0, 95.0)
ALIKE = 0.85  # share of a quantity's gain from which another one in its place is a look-alike
ABSENT_SHARE = 0.2  # of the other side's size, up to which an effect counts as absent on one side
UNBOUNDED = 1e9


@dataclass(frozen=True, eq=False)
class Found:
    """Both sides together. candidates: all quantities; chosen: indices of those that differ.

    subsets: costs of all sets. simulation, recordings: coordinates {name: value} of both sides, the first of
    them the estimate, then the draws.
    """

    candidates: tuple[Comparable, ...]
    chosen: Chosen
    subsets: Subsets
    simulation: tuple[Values, ...]
    recordings: tuple[Values, ...]


def found_between(recordings: FittedSide, simulation: FittedSide, seed: int = 1) -> Found:
    """The fewest quantities that explain the difference of two sides fitted with the same model."""
    coordinates = recordings.coordinates
    candidates = quantities(recordings.model, coordinates)
    columns = [q.columns(coordinates) for q in candidates]
    covariance = recordings.covariance + simulation.covariance
    subsets = Subsets(recordings.values - simulation.values, covariance, columns)
    chosen = fewest(subsets, {k for k, q in enumerate(candidates) if q.effect is not None})
    b = np.column_stack([np.zeros((len(coordinates), 0)), *(columns[k] for k in chosen)])
    both = _both(recordings, simulation, b, seed)
    return Found(candidates, chosen, subsets, *both)


def _both(
    recordings: FittedSide, simulation: FittedSide, b: Array, seed: int
) -> tuple[tuple[Values, ...], tuple[Values, ...]]:
    """(simulation, recordings): coordinates of the estimate and of the draws."""
    pd, ps = np.linalg.inv(recordings.covariance), np.linalg.inv(simulation.covariance)
    normal = np.block([[pd + ps, pd @ b], [b.T @ pd, b.T @ pd @ b]])
    normal += 1e-12 * np.trace(normal) / len(normal) * np.eye(len(normal))
    right = np.concatenate((pd @ recordings.values + ps @ simulation.values, b.T @ pd @ recordings.values))
    covariance = np.linalg.inv(normal)
    centre = covariance @ right
    values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    random = np.random.default_rng(seed).standard_normal((DRAWS, centre.size))
    drawn = centre + random * np.sqrt(np.maximum(values, 0.0)) @ axes.T
    rows = np.vstack((centre, drawn))
    k = len(recordings.coordinates)
    return _named(recordings, rows[:, :k]), _named(recordings, rows[:, :k] + rows[:, k:] @ b.T)


def _named(side: FittedSide, rows: Array) -> tuple[Values, ...]:
    """Coordinates (n, k) over their scales as {name: value}, within their bounds."""
    scale = np.array([c.scale for c in side.coordinates])
    low, high = (np.array([getattr(c, end) for c in side.coordinates]) for end in ("low", "high"))
    names = [c.name for c in side.coordinates]
    inside = np.clip(rows * scale, low, high)
    return tuple({**side.fitted.x, **dict(zip(names, map(float, row), strict=True))} for row in inside)


def differences(found: Found) -> tuple[tuple[Difference, ...], tuple[Difference, ...]]:
    """(those that matter, those within normal tolerance), instruments first, then the largest gain."""
    every = [(_difference(found, k), _matters(found, k)) for k in found.chosen]
    order: dict[Kind, int] = {"instrument": 0}
    every.sort(key=lambda e: (order.get(e[0].kind, 1), -e[0].gain))
    return tuple(d for d, m in every if m), tuple(d for d, m in every if not m)


def _difference(found: Found, k: int) -> Difference:
    q = found.candidates[k]
    simulation, recordings = (_values(q, side) for side in (found.simulation, found.recordings))
    kind = _kind(q, found)
    rest = tuple(c for c in found.chosen if c != k)
    gain = found.subsets.left(rest) - found.subsets.left(found.chosen)
    change = {
        one.name: two.value / one.value if q.relative and one.value else two.value - one.value
        for one, two in zip(simulation, recordings, strict=True)
    }
    alike = _look_alikes(found, k, rest, gain)
    words = difference_sentence(kind, q.name, simulation, recordings, q.relative)
    return Difference(kind, q.name, simulation, recordings, change, q.relative, gain, alike, words)


def _look_alikes(found: Found, k: int, rest: Chosen, gain: float) -> tuple[str, ...]:
    """Other quantities that explain nearly as much in its place."""
    base = found.subsets.left(rest)
    gains = {
        j: base - found.subsets.left((*rest, j))
        for j in range(len(found.candidates))
        if j not in found.chosen
    }
    near = sorted(
        (j for j, g in gains.items() if g > ALIKE * gain and g > gain - PENALTY), key=lambda j: -gains[j]
    )
    return tuple(found.candidates[j].name for j in near)


def _values(q: Comparable, side: Sequence[Values]) -> tuple[EffectValue, ...]:
    centre, *drawn = side
    reports = [q.report(x) for x in drawn]
    out = []
    for name, (value, unit, meaning) in q.report(centre).items():
        low, high = np.percentile([min(max(r[name][0], -1e12), 1e12) for r in reports], LEVEL)
        out.append(EffectValue(name, unit, min(value, UNBOUNDED), _limit(low), _limit(high), meaning))
    return tuple(out)


def _limit(x: float) -> float | None:
    return float(x) if abs(x) < UNBOUNDED else None


def _amounts(q: Comparable, x: Values) -> Array:
    return np.array([x.get(next(iter(part)), 0.0) for part in q.parts])


def _kind(q: Comparable, found: Found) -> Kind:
    """The kind of a chosen quantity; of an effect by which side has it."""
    if q.effect is None or q.kind == "instrument":
        return q.kind
    if q.effect.id in ("tyre_slip", "roll_dof"):
        return "left out"
    one, two = (float(np.abs(_amounts(q, side[0])[0])) for side in (found.simulation, found.recordings))
    if one < ABSENT_SHARE * two:
        return "left out"
    return "too much" if two < ABSENT_SHARE * one else "size"


def _matters(found: Found, k: int) -> bool:
    q = found.candidates[k]
    moved = _moved(q, found.recordings[0], found.simulation[0])
    return moved >= q.matters


def _moved(q: Comparable, one: Values, two: Values) -> float:
    """How far the quantity's first direction moves between two sides."""
    name, per = next(iter(q.parts[0].items()))
    if q.relative:
        values = [next(iter(q.report(x).values()))[0] for x in (one, two)]
        return abs(float(np.log(values[0] / values[1]))) if min(values) > 0 else np.inf
    return abs(one.get(name, 0.0) - two.get(name, 0.0)) / abs(per)
