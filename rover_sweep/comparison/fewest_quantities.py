"""The fewest quantities whose difference explains the difference of two fits.

With the difference d (k,) of the coordinates of both fits and its covariance S, and the candidates' columns
B, the set T of candidates leaves

    Q(T) = min over c of (d - B_T c)^T S^-1 (d - B_T c)

The set with the least Q(T) + PENALTY |T| is searched by adding, removing and exchanging one at a time, from
the full set and from the best of all sets of up to three (Miller 2002, Subset Selection in Regression).
Under no difference, one of 30 candidates gains more than PENALTY in less than 1 % of cases. The law of
an effect is never quite the true one, so a large effect leaves small false differences beside it: a candidate
that gains less than SPILL of the largest effect is left out.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import combinations

import numpy as np

from rover_sweep.data.recording import Array

PENALTY = 14.0
SPILL = 0.01  # a true difference of 374 and a false one of 44 stood beside an effect of 32 000
ALL_OF = 3  # candidates of the sets that are all tried
MOST = 14  # candidates of one set
Chosen = tuple[int, ...]


class Subsets:
    """The costs of sets of candidates. whitened: d (k,) and each candidate's columns (k, m) in S^(-1/2)."""

    def __init__(self, difference: Array, covariance: Array, candidates: Sequence[Array]) -> None:
        values, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
        root = axes / np.sqrt(np.maximum(values, 1e-12 * values[-1]))
        self.difference = difference @ root
        self.columns = [root.T @ c for c in candidates]
        self._known: dict[frozenset[int], float] = {}

    def left(self, chosen: Sequence[int]) -> float:
        """Q of a set."""
        key = frozenset(chosen)
        if key not in self._known:
            self._known[key] = self._left(sorted(key))
        return self._known[key]

    def _left(self, chosen: Sequence[int]) -> float:
        if not chosen:
            return float(self.difference @ self.difference)
        b = np.column_stack([self.columns[k] for k in chosen])
        q, r = np.linalg.qr(b)
        size = np.abs(np.diag(r))
        seen = q[:, size > 1e-9 * max(float(size.max()), 1e-300)].T @ self.difference
        return float(self.difference @ self.difference - seen @ seen)

    def amount(self, k: int, chosen: Sequence[int]) -> tuple[float, float]:
        """(amount of a candidate's first column beside a set, its standard deviation)."""
        others = [c for c in chosen if c != k]
        b = np.column_stack([self.columns[k], *(self.columns[c] for c in others)])
        inverse = np.linalg.pinv(b.T @ b, rcond=1e-12)
        return float((inverse @ b.T @ self.difference)[0]), float(np.sqrt(max(inverse[0, 0], 0.0)))

    def score(self, chosen: Sequence[int]) -> float:
        """Q plus the penalty of its parameters."""
        return self.left(chosen) + PENALTY * sum(self.columns[k].shape[1] for k in chosen)


def fewest(subsets: Subsets, effects: Collection[int] = ()) -> Chosen:
    """The best set that the search finds, in the order of the candidates. effects: those that are one."""
    every = range(len(subsets.columns))
    starts = [_shrunk(subsets, tuple(every))]
    starts += [min(combinations(every, n), key=subsets.score) for n in range(min(ALL_OF, len(every)) + 1)]
    best = min((_improved(subsets, start) for start in starts), key=subsets.score)
    return _without_spill(subsets, best, effects)


def _without_spill(subsets: Subsets, chosen: Chosen, effects: Collection[int]) -> Chosen:
    """The set without candidates, the least first, that gain less than `SPILL` of the largest effect."""
    while chosen:
        gains = {k: subsets.left(_without(chosen, k)) - subsets.left(chosen) for k in chosen}
        least = min(chosen, key=lambda k: gains[k])
        if gains[least] >= SPILL * max((gains[k] for k in chosen if k in effects), default=0.0):
            break
        chosen = _without(chosen, least)
    return chosen


def _shrunk(subsets: Subsets, chosen: Chosen) -> Chosen:
    """The set without candidates, one at a time, that cost least to remove, down to `MOST`."""
    while len(chosen) > MOST:
        chosen = min((_without(chosen, k) for k in chosen), key=subsets.left)
    return chosen


def _improved(subsets: Subsets, chosen: Chosen) -> Chosen:
    while True:
        best = min(_neighbours(subsets, chosen), key=subsets.score)
        if subsets.score(best) >= subsets.score(chosen) - 1e-9:
            return chosen
        chosen = best


def _neighbours(subsets: Subsets, chosen: Chosen) -> Iterator[Chosen]:
    others = [k for k in range(len(subsets.columns)) if k not in chosen]
    if len(chosen) < MOST:
        yield from (tuple(sorted((*chosen, k))) for k in others)
    for gone in chosen:
        rest = _without(chosen, gone)
        yield rest
        yield from (tuple(sorted((*rest, k))) for k in others)


def _without(chosen: Chosen, gone: int) -> Chosen:
    return tuple(k for k in chosen if k != gone)
