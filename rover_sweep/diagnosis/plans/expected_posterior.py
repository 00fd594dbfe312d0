"""The probabilities that a diagnosis of planned runs is expected to give, from Gram matrices alone.

To first order the rows of a set of runs are y = J h + T n + S a + e: nominal coordinates h, tolerances n,
amounts a of an effect, noise e. Everything that `posterior.weights` weighs then follows from the scores
s = (J, T, S)^T y and the Gram matrix K of the columns. An explanation frees its own columns; its cost is the
minimum over h, n and a, within the tolerances of h:

    C(E) = |y|^2 + min over z of (z^T (K + W) z - 2 z^T s),   W: information of the priors

and its weight has the same tempering, widths of parameters and prior odds as that of driven runs. Something
else is assumed to explain as much as the best explanation. Data are drawn from the model that the posterior
assumes: an effect at its size beyond the tolerances, tolerances and noise with the variance `COARSE` with
which they count. Hence

    information = sum over truths E of p(E) mean of log[P(E | y)/p(E)]

is the mutual information of explanation and data: what an experiment reveals about the right model (Box and
Hill 1967, Technometrics 9(1); Chaloner and Verdinelli 1995, Statist. Sci. 10(3)). An added run cannot lower
it. Explanations are single effects; a further one has the prior odds `FURTHER`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import log

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.posterior.infer import SHARE, SURE
from rover_sweep.diagnosis.posterior.model_fit import (
    COMMON,
    OWN,
    errors_of_coefficients,
    errors_of_responses,
    fit_with_floor,
)
from rover_sweep.diagnosis.posterior.weights import ELSE, FIRST, POWER, SPAN, WIDTH
from rover_sweep.diagnosis.problem.least_squares import (
    COARSE,
    WEAK,
    Fitted,
    Signature,
    columns,
    sensitivities,
    signatures,
    speed_drift,
)
from rover_sweep.diagnosis.problem.noise_floor import Floor
from rover_sweep.diagnosis.problem.residuals import Problem, Rows, whitened, with_floor
from rover_sweep.diagnosis.search import INSTANTS
from rover_sweep.diagnosis.simulation.candidates import Model
from rover_sweep.diagnosis.simulation.experiment import RATE, Experiment
from rover_sweep.diagnosis.simulation.simulator import wheel_angle

DRAWS = 32  # sets of data of each truth
NONE, OTHER = "", "something else"


@dataclass(frozen=True, eq=False)
class RunSet:
    """A set of runs. k columns: nominal coordinates with bounds, and effects; others are eliminated.

    keys: of the columns, with the run of an effect in one run. gram (k + 1, k + 1), noise (draws, k + 1):
    scores of noise and tolerances; the last column is 0.
    """

    given: Assumed
    keys: tuple[tuple[str, str, int], ...]
    gram: Array
    noise: Array

    @staticmethod
    def of(given: Assumed, runs: Sequence[RunEvidence]) -> RunSet:
        """The set of these runs; list a repeated run again."""
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

    def truth(self, effect: str, amount: float) -> Array:
        """Amounts (k + 1,) of all columns if the effect has this amount, in units of its reach."""
        out = np.zeros(len(self.keys) + 1)
        if effect == NONE:
            return out
        p = self.given.first(effect)
        columns = (k for k, key in enumerate(self.keys) if key[:2] == (effect, p.name))
        out[max(columns, key=lambda k: self.gram[k, k])] = amount  # in the run that shows it best
        for c in self.given.model.free:
            if c.name == p.nominal:
                start = self.given.reach[effect, p.name].start - self.given.x[c.name]
                out[self.keys.index(("nominal", c.name, 0))] = start / c.scale
        return out

    @cached_property
    def explanations(self) -> list[tuple[str, list[int]]]:
        """(effect, its columns), one per run for an effect in one run; (NONE, no columns) first."""
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


@dataclass(frozen=True)
class SimilarPair:
    """A pair that is not separated; expected probability of the second if the first is true."""

    first: str
    second: str
    probability: float


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
        """For each truth {label: expected probability}."""
        mean = np.mean(self.probabilities, axis=2)
        return [dict(zip(self.labels, p.tolist(), strict=True)) for p in mean]

    @property
    def sure(self) -> dict[str, float]:
        """{truth: its own expected probability}."""
        return {truth: share[truth] for truth, share in zip(self.truths, self.shares, strict=True)}

    @property
    def separated(self) -> tuple[str, ...]:
        """The true effects that are expected to be named."""
        return tuple(e for e, p in self.sure.items() if e != NONE and p >= SURE)

    @property
    def look_alikes(self) -> tuple[SimilarPair, ...]:
        """Effects not separated, each with those that share its probability, largest first."""
        named = (NONE, *self.separated)
        pairs = [
            SimilarPair(e, other, p)
            for e, row in zip(self.truths, self.shares, strict=True)
            if e not in named and row[NONE] < SHARE
            for other, p in row.items()
            if other != e and p >= SHARE
        ]
        return tuple(sorted(pairs, key=lambda pair: -pair.probability))

    def information(self, odds: Mapping[str, float] | None = None) -> float:
        """Expected information on the explanations [bit]. odds: of the truths, None for the prior ones."""
        logs = np.log2(np.maximum(self.probabilities, WEAK))
        p = np.array([(self.prior if odds is None else odds).get(truth, 0.0) for truth in self.truths])
        right = [each[self.labels.index(truth)] for truth, each in zip(self.truths, logs, strict=True)]
        gain = np.mean(right, axis=1) - np.log2([self.prior[truth] for truth in self.truths])
        return float(p @ gain / np.sum(p))


def expected(runs: RunSet, effects: Sequence[str], amounts: Sequence[float] | None = None) -> Expected:
    """The weights of all explanations when each effect, or NONE, is true.

    amounts: of the effects, in units of their reach; None: 1 for each.
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
    column's unit. own: True for the columns of the effect; tied: for coordinates that the effect extends.
    """

    idx: NDArray[np.intp]
    inner: Array
    low: Array
    high: Array
    width: Array
    own: NDArray[np.bool_]
    tied: NDArray[np.bool_]

    def limited(self, scores: Array) -> tuple[Array, NDArray[np.bool_]]:
        """(values, True at a bound), each (truths, explanations, d), of the fit without noise.

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
        """(truths, explanations): ln of posterior width over prior width of the own parameters."""
        inner = self._held((pinned & ~self.own) | self.tied)
        spread = np.sqrt(COARSE * np.diagonal(np.linalg.inv(inner), axis1=2, axis2=3))
        widths = np.minimum(np.log(SPAN * spread / self.width), 0.0)
        return np.asarray(np.sum(np.where(self.own, widths, 0.0), axis=2))

    def _solved(self, at: Array, fixed: Array, pinned: NDArray[np.bool_]) -> Array:
        """The minimum (truths, explanations, d, n) for scores of this shape, with some values held."""
        right = np.where(pinned[..., None], fixed[..., None], at - self.inner @ fixed[..., None])
        return np.asarray(np.linalg.solve(self._held(pinned), right), float)

    def _held(self, pinned: NDArray[np.bool_]) -> Array:
        """K + W (truths, explanations, d, d) with the held values decoupled."""
        free = (~pinned).astype(float)
        coupled = self.inner * free[..., :, None] * free[..., None, :]
        return np.asarray(coupled + np.eye(free.shape[2]) * pinned[..., None, :])


# What one planned run would show, as inner products of columns of its whitened rows.
#
# A plan needs no more of a run than the Gram matrix of these columns: the sensitivities to the nominal
# coordinates, the signatures of the effects, and what every rover has (tolerances and the model's own error).
# What belongs to this run alone, such as the slow error of its measured speed, is eliminated here: with the
# columns O at one standard deviation, the Gram matrix G of the others becomes G - G_o (I + O^T O)^-1 G_o^T,
# that of rows in the metric of noise and O. Runs of a set are then added.


NOISE = {
    "Hz": (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0),
    "r": (1.3e-4, 1.2e-4, 1.1e-4, 1.1e-4, 7.5e-5, 4.5e-5, 2.2e-5, 1.1e-5, 3.2e-6, 1.2e-6, 5.6e-7, 3.2e-7),
    "ay": (2.0e-3, 2.2e-3, 2.5e-3, 3.2e-3, 4.0e-3, 3.5e-3, 2.6e-3, 1.8e-3, 1.6e-3, 1.2e-3, 8.5e-4, 6e-4),
    "p": (3.5e-6, 5.5e-6, 1.0e-5, 2.2e-5, 7.5e-5, 1.4e-4, 3.0e-4, 2.5e-4, 8.0e-5, 3.0e-5, 1.2e-5, 5.5e-6),
    "vy": (2.0e-4, 1.5e-4, 1.0e-4, 7.0e-5, 4.0e-5, 2.0e-5, 6.0e-6, 3.0e-6, 1.3e-6, 6e-7, 3e-7, 1.5e-7),
}
"""One-sided noise densities, unit^2/Hz: geometric means of the floors of recordings of five rovers of 2.6 kg,
on the official firmware, on two plants of different authors. The road shakes the rover, so the noise has the
shape of its yaw and roll response; single rovers differ by a factor of 3 below 2 Hz."""
TYPICAL = {"ln_C": log(2.5 / 3.0), "ln_b_phi": log(2.0)}
"""{coordinate: difference to the start of a fit}: in recordings of seven small rovers C is 2.1 to 2.7 times
m g/2, and the roll mode has 0.37 to 0.43 of its critical damping. A fit starts from half that damping, with
which roll steer would show twice as much."""

# A camera or a potentiometer at a wheel of a rover on blocks: 0.3 deg rms at 60 Hz.
ANGLE_NOISE = 2 * (0.3 * np.pi / 180.0) ** 2 / 60.0  # rad^2/Hz
ANGLE_BAND = (0.05, 8.0)  # Hz
ANGLE_SCALE, ANGLE_CLOCK = 0.03, 0.005  # standard deviations of the relative scale, and of the offset [s]

Key = tuple[str, str]
"""Of a column: ("nominal", coordinate), ("usual", tolerance) or (effect, parameter)."""


@dataclass(frozen=True)
class Reach:
    """Range of an effect's coordinate.

    start: end of the nominal tolerance, or 0 (absent). distance: signed, from start to the effect's size.
    end: the effect's bound.
    """

    start: float
    distance: float
    end: float

    @property
    def most(self) -> float:
        """Largest multiple of the distance."""
        return (self.end - self.start) / self.distance


@dataclass(frozen=True, eq=False)
class RunEvidence:
    """k columns of a run, by keys. gram (k, k): inner products; root (k, k): its square root."""

    keys: tuple[Key, ...]
    gram: Array
    root: Array


@dataclass(frozen=True, eq=False)
class Basis:
    """A run's columns without effects: rows (size, k) named by keys; own (size, m): of this run only."""

    problem: Problem
    base: Fitted
    keys: tuple[Key, ...]
    rows: Array
    own: Array


@dataclass(frozen=True, eq=False)
class Assumed:
    """Assumptions of a plan: the noise floor, and the rover that may have the effects.

    effects: by their ids. x: {coordinate: value} of the nominal model. reach: of the effects' signatures.
    """

    model: Model
    effects: Mapping[str, Effect]
    floor: Floor
    x: Mapping[str, float]
    reach: Mapping[Key, Reach]

    def first(self, effect: str) -> EffectParameter:
        """The effect's first parameter with a size; the effect is judged by it."""
        return next(p for p in self.effects[effect].parameters if (effect, p.name) in self.reach)

    def sized(self, sizes: Mapping[str, float]) -> Assumed:
        """A copy with other sizes {effect: multiple of its own}."""
        far = {k: replace(r, distance=sizes.get(k[0], 1.0) * r.distance) for k, r in self.reach.items()}
        return replace(self, reach=far)


@dataclass(frozen=True, eq=False)
class OnBlocks(Problem):
    """The rover is on blocks and its wheel angle is measured; tyres and body have no effect."""

    def plain_models(self, model: Model, xs: Sequence[Mapping[str, float]]) -> list[Array]:
        """The rows (size,) that the model predicts."""
        angles = [{"delta": wheel_angle(self.runs[0], model, x)} for x in xs]
        return [whitened(self.rows, self.runs, [angle]) for angle in angles]


def assumed(driven: Sequence[Experiment], model: Model, effects: Sequence[Effect]) -> Assumed:
    """Noise floor and model fitted to the recordings; without recordings, those of a small rover."""
    x = {c.name: float(np.clip(c.start + TYPICAL.get(c.name, 0.0), c.low, c.high)) for c in model.free}
    floor = Floor(np.array(NOISE["Hz"]), {c: np.array(d) for c, d in NOISE.items() if c != "Hz"})
    if moving := [run for run in driven if run.kind != "servo_test"]:
        problem, fitted = fit_with_floor(moving, model, x, near=True)
        f, x = problem.floor.f, dict(fitted.x)
        floor = Floor(f, {c: floor.at(c, f) for c in floor.density} | dict(problem.floor.density))
    reach = {(e.id, p.name): _reach(model, e, p) for e in effects for p in e.parameters if p.name != "t"}
    return Assumed(
        model, {e.id: e for e in effects}, floor, x, {k: r for k, r in reach.items() if r.distance}
    )


def _reach(model: Model, effect: Effect, p: EffectParameter) -> Reach:
    """The reach of a parameter, from its nominal tolerance to its own size."""
    bounds = {c.name: c for c in model.free}
    if p.nominal and p.nominal not in bounds:
        return Reach(0.0, 0.0, 0.0)
    free = next(c for c in model.with_effect(effect.name).free if c.name == effect.coordinate_name(p))
    if not p.nominal:
        return Reach(0.0, p.size, free.high)
    if free.high > bounds[p.nominal].high:
        return Reach(bounds[p.nominal].high, p.size * p.per, free.high)
    return Reach(bounds[p.nominal].low, -p.size * p.per, free.low)


def basis(run: Experiment, given: Assumed) -> Basis:
    """The columns of a run without the effects."""
    blocks, model, effects = run.kind == "servo_test", given.model, list(given.effects.values())
    problem = _on_blocks(run) if blocks else with_floor([run], given.floor)
    nothing = np.zeros(problem.size)
    base = Fitted(model, given.x, model.free, 0.0, nothing, nothing[:, None])
    expected = problem.model(model, given.x)
    problem = replace(problem, measured=expected, plain_measured=expected)
    base = sensitivities(problem, base)
    usual = signatures(problem, base, effects, tolerances=True)
    own = [s for s in usual if given.effects[s.effect].in_one_run]
    shared = [s for s in usual if not given.effects[s.effect].in_one_run]
    if blocks:
        own += _measured(problem, given)
    else:
        errors = errors_of_responses(problem, base)
        shared += [*errors_of_coefficients(problem, base), *errors]
        own += [replace(s, run=None) for s in speed_drift(problem, base)]  # the problem has one run
        own += [replace(s, rows=s.rows * (OWN / COMMON)) for s in errors]
    keys = [
        *(("nominal", c.name) for c in model.free),
        *(("usual", f"{s.effect} {s.parameter}") for s in shared),
    ]
    rows = np.column_stack((base.jacobian, *(s.rows for s in shared)))
    return Basis(problem, base, tuple(keys), rows, columns(own, problem.size))


def evidence(run: Basis, given: Assumed) -> RunEvidence:
    """The columns of a run, with the signatures of effects at their reach."""
    found: list[Signature] = []
    for effect, p in ((e, q) for e in given.effects.values() for q in e.parameters):
        if one := given.reach.get((effect.id, p.name)):  # two effects may move the same nominal coordinate
            at = {effect.coordinate_name(p): one.distance}
            base = replace(run.base, x={**run.base.x, p.nominal: one.start}) if p.nominal else run.base
            law = replace(effect, parameters=(p, *(q for q in effect.parameters if q.name == "t")))
            found += signatures(run.problem, base, [law], at)
    every = np.column_stack((run.rows, *(s.rows for s in found)))
    across = every.T @ run.own
    left = np.linalg.solve(np.eye(run.own.shape[1]) + run.own.T @ run.own, across.T)
    gram: Array = np.asarray(every.T @ every - across @ left)
    values, vectors = np.linalg.eigh(gram)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return RunEvidence((*run.keys, *((s.effect, s.parameter) for s in found)), gram, root)


def _on_blocks(run: Experiment) -> OnBlocks:
    f: Array = np.asarray(np.fft.rfftfreq(run.t.size, 1 / RATE), np.float64)
    bins = np.flatnonzero((f >= ANGLE_BAND[0]) & (f <= ANGLE_BAND[1]))
    weight = np.full(bins.size, 1.0 / np.sqrt(ANGLE_NOISE * RATE / 4 * np.sum(run.taper**2)))
    nothing = np.zeros(2 * bins.size)
    none = Floor(np.ones(1), {})  # the noise of the angle is in the weight
    return OnBlocks((run,), none, (Rows(0, "delta", bins, f[bins], weight, 0),), nothing, nothing)


def _measured(problem: Problem, given: Assumed) -> list[Signature]:
    """Signatures of scale and clock of the angle measurement, at one standard deviation."""
    row, run = problem.rows[0], problem.runs[0]
    lines = rfft(wheel_angle(run, given.model, given.x) * run.taper)[row.bins] * row.weight
    late = lines * (-2j * np.pi * row.f) * ANGLE_CLOCK
    return [
        Signature("servo_test", name, size, np.concatenate((part.real, part.imag)))
        for name, size, part in (("scale", ANGLE_SCALE, lines * ANGLE_SCALE), ("clock", ANGLE_CLOCK, late))
    ]
