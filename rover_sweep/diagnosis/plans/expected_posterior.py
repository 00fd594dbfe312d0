"""The probabilities that a diagnosis of planned runs is expected to give, from Gram matrices alone.

To first order the rows of a set of runs are y = J h + T n + S a + e: nominal coordinates, what every rover
has, and the amounts a of an effect. Everything that `posterior.weights` weighs then follows from the scores
s = (J, T, S)^T y and the Gram matrix K of the columns. An explanation frees its own columns; its cost is the
minimum over h, n and a, within the tolerances of h:

    C(E) = |y|^2 + min over z of (z^T (K + W) z - 2 z^T s),   W: information of the priors

and its weight has the same tempering, widths of parameters and prior odds as that of driven runs. Something
else is expected to explain as much as the best explanation. Data are drawn from the model that the posterior
assumes: an effect at its size beyond the tolerances, tolerances and noise with the variance `COARSE` with
which they count. Hence

    information = sum over truths E of p(E) mean of log[P(E | y)/p(E)]

is the mutual information of explanation and data, what an experiment tells about which model is right
(Box and Hill 1967, Technometrics 9(1); Chaloner and Verdinelli 1995, Statist. Sci. 10(3)). An added run
cannot lower it. Explanations are single effects; a further one has the prior odds `FURTHER`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import log

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.plans.run_evidence import Assumed, RunEvidence
from rover_sweep.diagnosis.posterior.weights import ELSE, FIRST, POWER, SPAN, WIDTH
from rover_sweep.diagnosis.problem.least_squares import COARSE, WEAK
from rover_sweep.diagnosis.search import INSTANTS

DRAWS = 32  # sets of data of each truth
NONE, OTHER = "", "something else"


@dataclass(frozen=True, eq=False)
class RunSet:
    """Runs together. k columns: nominal coordinates with bounds, and effects; the others are eliminated.

    keys: of the columns, with the run of an effect that happens in one. gram (k + 1, k + 1), noise
    (draws, k + 1): scores of noise and tolerances; the last one is empty.
    """

    given: Assumed
    keys: tuple[tuple[str, str, int], ...]
    gram: Array
    noise: Array

    @staticmethod
    def of(given: Assumed, runs: Sequence[RunEvidence]) -> RunSet:
        """The set of these runs, each as often as it is driven."""
        alone = {e for e, effect in given.effects.items() if effect.in_one_run}
        named = [[(*key, n if key[0] in alone else 0) for key in run.keys] for n, run in enumerate(runs)]
        keys = sorted({key for each in named for key in each})
        gram, noise = np.zeros((len(keys), len(keys))), np.zeros((DRAWS, len(keys)))
        for n, (run, each) in enumerate(zip(runs, named, strict=True)):
            at = [keys.index(key) for key in each]
            gram[np.ix_(at, at)] += run.gram
            noise[:, at] += np.random.default_rng(n).standard_normal((DRAWS, len(at))) @ run.root
        known = {
            ("nominal", c.name, 0): COARSE * (c.scale / c.prior) ** 2 if c.prior else 0.0
            for c in given.model.free
        }
        tied = {p.nominal for e in given.effects.values() for p in e.parameters}
        gone = [k for k, key in enumerate(keys) if key[0] in ("usual", "nominal") and key[1] not in tied]
        kept = [k for k in range(len(keys)) if k not in set(gone)]
        prior = np.array([known.get(keys[k], COARSE) for k in gone])
        drawn = np.random.default_rng(len(gone)).standard_normal((DRAWS, len(gone)))
        noise += np.divide(drawn, np.sqrt(prior), out=np.zeros_like(drawn), where=prior > 0.0) @ gram[gone]
        inner = gram[np.ix_(gone, gone)] + np.diag(prior + WEAK * (1.0 + np.diag(gram)[gone]))
        moved = np.linalg.solve(inner, gram[np.ix_(gone, kept)])
        left = gram[np.ix_(kept, kept)] - gram[np.ix_(kept, gone)] @ moved
        scores = np.sqrt(COARSE) * (noise[:, kept] - noise[:, gone] @ moved)
        end = ((0, 0), (0, 1))
        return RunSet(given, tuple(keys[k] for k in kept), np.pad(left, (0, 1)), np.pad(scores, end))

    def column_of(self, effect: str) -> int:
        """The column of an effect's first parameter, in the run that shows it best."""
        name = self.given.first(effect).name
        return max(
            (k for k, key in enumerate(self.keys) if key[:2] == (effect, name)), key=lambda k: self.gram[k, k]
        )

    def truth(self, effect: str, amount: float) -> Array:
        """The amounts (k + 1,) where an effect has this amount, over its reach, beyond the tolerances."""
        out = np.zeros(len(self.keys) + 1)
        if effect == NONE:
            return out
        p = self.given.first(effect)
        out[self.column_of(effect)] = amount
        for c in self.given.model.free:
            if c.name == p.nominal:
                start = self.given.reach[effect, p.name].start - self.given.x[c.name]
                out[self.keys.index(("nominal", c.name, 0))] = start / c.scale
        return out

    @cached_property
    def explanations(self) -> list[tuple[str, list[int]]]:
        """(effect, its columns), of an effect in one run for each run; (NONE, no columns) first."""
        found: dict[tuple[str, int], list[int]] = {(NONE, 0): []}
        for k, (effect, _, run) in enumerate(self.keys):
            if effect != "nominal":
                found.setdefault((effect, run), []).append(k)
        return [(effect, columns) for (effect, _), columns in found.items()]

    @cached_property
    def batch(self) -> _Batch:
        """All explanations as one batch."""
        nominal, effects = {c.name: c for c in self.given.model.free}, self.given.effects
        size = len(self.keys) + 1
        low, high, width = (np.full(size, v) for v in (-np.inf, np.inf, 1.0))
        weight = WEAK * (1.0 + np.diag(self.gram))  # relative, against rounding
        weight[-1] = 1.0
        for k, (effect, name, _) in enumerate(self.keys):
            if effect == "nominal":
                c = nominal[name]
                weight[k] += COARSE * (c.scale / c.prior) ** 2 if c.prior else 0.0
                low[k], high[k] = (
                    (c.low - self.given.x[name]) / c.scale,
                    (c.high - self.given.x[name]) / c.scale,
                )
                continue
            p = next(q for q in effects[effect].parameters if q.name == name)
            low[k] = -np.inf if effects[effect].signed and not p.nominal else 0.0
            width[k] = WIDTH * p.size * p.per / abs(self.given.reach[effect, name].distance)
        bounded = [k for k, key in enumerate(self.keys) if key[0] == "nominal"]
        most = max(len(columns) for _, columns in self.explanations)
        idx = np.array([[*bounded, *own, *[size - 1] * (most - len(own))] for _, own in self.explanations])
        own = np.array([np.isin(row, own) for row, (_, own) in zip(idx, self.explanations, strict=True)])
        tied = np.zeros(idx.shape, bool)
        for row, (effect, _) in zip(tied, self.explanations, strict=True):
            on = {p.nominal for p in effects[effect].parameters} if effect != NONE else set()
            row[: len(bounded)] = [self.keys[k][1] in on for k in bounded]
        inner = self.gram[idx[:, :, None], idx[:, None, :]] + np.eye(idx.shape[1]) * weight[idx][:, :, None]
        return _Batch(idx, inner, low[idx], high[idx], width[idx], own, tied)


@dataclass(frozen=True, eq=False)
class Expected:
    """ln weights (truths, explanations, draws). labels: of the explanations, NONE first and OTHER last.

    prior: {label: probability} without data.
    """

    truths: tuple[str, ...]
    labels: tuple[str, ...]
    log_weights: Array
    prior: Mapping[str, float]

    @property
    def probabilities(self) -> Array:
        """(truths, explanations, draws)."""
        logs = self.log_weights - np.max(self.log_weights, axis=1, keepdims=True)
        return np.asarray(np.exp(logs) / np.sum(np.exp(logs), axis=1, keepdims=True))

    @property
    def shares(self) -> list[dict[str, float]]:
        """{label: its expected probability} for each truth."""
        mean = np.mean(self.probabilities, axis=2)
        return [dict(zip(self.labels, p.tolist(), strict=True)) for p in mean]

    @property
    def sure(self) -> dict[str, float]:
        """{truth: its own expected probability}."""
        return {truth: share[truth] for truth, share in zip(self.truths, self.shares, strict=True)}

    def information(self, odds: Mapping[str, float] | None = None) -> float:
        """Expected information on the explanations [bit]. odds: of the truths, None for the prior ones."""
        logs = np.log2(np.maximum(self.probabilities, WEAK))
        p = np.array([(self.prior if odds is None else odds).get(truth, 0.0) for truth in self.truths])
        right = [each[self.labels.index(truth)] for truth, each in zip(self.truths, logs, strict=True)]
        gain = np.mean(right, axis=1) - np.log2([self.prior[truth] for truth in self.truths])
        return float(p @ gain / np.sum(p))


def expected(runs: RunSet, effects: Sequence[str], amounts: Sequence[float] | None = None) -> Expected:
    """The weights of all explanations where each effect, or NONE, is the truth.

    amounts: of the effects, over their reach; None for the reach of each.
    """
    batch, names = runs.batch, [name for name, _ in runs.explanations]
    truths = zip(effects, amounts or [1.0] * len(effects), strict=True)
    scores = np.array([runs.truth(effect, amount) for effect, amount in truths]) @ runs.gram
    fixed, pinned = batch.limited(scores)
    cost = batch.costs(scores[:, None, :] + runs.noise, fixed, pinned)
    gain = 0.5 * (cost[:, :1] - cost) / COARSE
    logs = gain + batch.occam(pinned)[:, :, None]
    labels = tuple(dict.fromkeys(names))
    first = {NONE: 0.0, OTHER: ELSE}
    for label in labels[1:]:
        tries = len(runs.given.model.laws(label)) * names.count(label)
        first[label] = FIRST - log(tries * INSTANTS if runs.given.effects[label].in_one_run else tries)
    of = {label: [name == label for name in names] for label in labels}
    each = [first[label] + np.logaddexp.reduce(logs[:, of[label]], axis=1) for label in labels]
    each.append(first[OTHER] + POWER * np.max(gain, axis=1))
    whole = np.logaddexp.reduce(list(first.values()))
    prior = {label: float(np.exp(w - whole)) for label, w in first.items()}
    return Expected(tuple(effects), (*labels, OTHER), np.stack(each, axis=1), prior)


@dataclass(frozen=True, eq=False)
class _Batch:
    """All explanations with as many columns d each, so that they are solved at once; (explanations, d) each.

    idx: their columns. inner (explanations, d, d): K + W. low, high: bounds. width: of the prior, in the
    column's unit. own: True for the columns of the effect; tied: for the coordinates that it goes on from.
    """

    idx: NDArray[np.intp]
    inner: Array
    low: Array
    high: Array
    width: Array
    own: NDArray[np.bool_]
    tied: NDArray[np.bool_]

    def limited(self, scores: Array) -> tuple[Array, NDArray[np.bool_]]:
        """(values, True where it is at its bound), (truths, explanations, d), of the fit without noise.

        scores (truths, k + 1). Each pass holds the coordinate that leaves its bounds farthest.
        """
        at = scores[:, self.idx]
        pinned, fixed = np.zeros(at.shape, bool), np.zeros(at.shape)
        for _ in range(at.shape[2]):
            found = self._solved(at[..., None], fixed, pinned)[..., 0]
            over = np.where(pinned, 0.0, np.maximum(self.low - found, found - self.high))
            new = (over > WEAK) & (np.arange(at.shape[2]) == np.argmax(over, axis=2)[..., None])
            if not new.any():
                break
            pinned, fixed = pinned | new, np.where(new, np.clip(found, self.low, self.high), fixed)
        return fixed, pinned

    def costs(self, scores: Array, fixed: Array, pinned: NDArray[np.bool_]) -> Array:
        """Least costs (truths, explanations, draws) without |y|^2. scores (truths, draws, k + 1)."""
        at = np.moveaxis(scores[:, :, self.idx], 1, 3)
        found = self._solved(at, fixed, pinned)
        return np.asarray(np.sum(found * (self.inner @ found - 2.0 * at), axis=2))

    def occam(self, pinned: NDArray[np.bool_]) -> Array:
        """(truths, explanations): ln of the widths left to the own parameters over those of the priors."""
        inner = self._held((pinned & ~self.own) | self.tied)
        spread = np.sqrt(COARSE * np.diagonal(np.linalg.inv(inner), axis1=2, axis2=3))
        widths = np.minimum(np.log(SPAN * spread / self.width), 0.0)
        return np.asarray(np.sum(np.where(self.own, widths, 0.0), axis=2))

    def _solved(self, at: Array, fixed: Array, pinned: NDArray[np.bool_]) -> Array:
        """The minimum (truths, explanations, d, n) for scores of this shape, with some values held."""
        right = np.where(pinned[..., None], fixed[..., None], at - self.inner @ fixed[..., None])
        return np.asarray(np.linalg.solve(self._held(pinned), right))

    def _held(self, pinned: NDArray[np.bool_]) -> Array:
        """K + W (truths, explanations, d, d) with the held values decoupled."""
        free = (~pinned).astype(float)
        coupled = self.inner * free[..., :, None] * free[..., None, :]
        return np.asarray(coupled + np.eye(free.shape[2]) * pinned[..., None, :])
