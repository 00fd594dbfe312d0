"""How probable each explanation is.

    ln w(E) = -[C(E) - C(none)]/(2 t v) - [H(E) - H(none)]/(2 t_h v_h) + ln Occam(E) + ln prior(E)

C: sum of squares of rows and priors in the runs of the fit, H: of the rows of held-out runs, to which nothing
is fitted. v, v_h: mean squares of a row under the best explanation, at least 1. t, t_h: no model is exact, so
a row counts less than an independent measurement (`problem.least_squares`). Occam: posterior width over prior
width of each parameter of an effect, once for each form, and run, that was tried (Laplace's approximation:
MacKay 1992, Neural Computation 4(3)).

With E there may be something else, a family f without a name (`unnamed`), which has the weight

    w(E and something else) = w(E) prior sum over f of exp(power ln Z(f) - [H(E, f) - H(E)]/(2 t_h v_h))

Z: its marginal likelihood over that of E alone. An effect of E may then be a proxy for f. The effect is
kept with the probability 1/(1 + (kept u/g)^2), u the drop of the cost by the best family and g the one by the
effect.

The hyperparameters below have the largest mean log score on drawn rovers of several engines
(`python -m tests.engines.calibrate`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, log, prod, sqrt

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.posterior.unnamed import UnnamedFamily
from rover_sweep.diagnosis.problem.least_squares import COARSE, WEAK, Fitted, prior_information
from rover_sweep.diagnosis.search import is_material

COARSE_HELD = 4.5  # t_h
FIRST, FURTHER = -0.85, -2.7  # ln prior of one effect over none, and of each further one
ELSE, POWER = -3.2, 0.45  # ln prior of something else, and the power of its marginal likelihood
KEPT = 6.0  # gain of an effect over that of something else, at which it is a proxy in half of the cases
LEAST_GAIN = 13.0  # drop of the cost over the variance of a row, below which an effect does not matter
WIDTH = 2.5  # prior width of a parameter over the size at which its effect is plainly visible
HUGE = 1e9  # standard deviation of a coordinate that the data do not hold
SPAN = sqrt(2.0 * np.pi)  # width of a normal density of unit height over its standard deviation


@dataclass(frozen=True)
class ExplanationEvidence:
    """The evidence for one explanation.

    effects: their ids. cost: sum of squares of rows and priors; rows: number of rows; data: their sum of
    squares. held: sum of squares of the held-out rows, 0 without such runs. tries: forms, and runs, that were
    tried. widths: posterior over prior width of each parameter, at a row variance of 1. material: ids of the
    effects whose size matters.
    """

    effects: frozenset[str]
    cost: float
    data: float
    rows: int
    held: float
    tries: int
    widths: tuple[float, ...]
    material: frozenset[str]

    @property
    def variance(self) -> float:
        """Mean square of a row."""
        return self.data / self.rows


@dataclass(frozen=True, eq=False)
class SomethingElse:
    """Unnamed families in the residual of the explanation with these effects, and their changes (n,) of the
    held-out sum of squares."""

    effects: frozenset[str]
    families: tuple[UnnamedFamily, ...]
    held: Array


@dataclass(frozen=True, eq=False)
class Weighed:
    """An explanation with its probability. matters: {effect: probability that it is real and matters}.

    unnamed: plus something else.
    """

    effects: frozenset[str]
    probability: float
    matters: Mapping[str, float]
    unnamed: bool = False

    @property
    def named(self) -> frozenset[str]:
        """Ids of its effects that matter."""
        return frozenset(self.matters)


@dataclass(frozen=True, eq=False)
class Posterior:
    """The explanations with and without something else, the most probable one first."""

    weighed: tuple[Weighed, ...]

    @property
    def effects(self) -> dict[str, float]:
        """{effect: probability that it is present and matters}, the largest first."""
        found: dict[str, float] = {}
        for one in self.weighed:
            for effect, real in one.matters.items():
                found[effect] = found.get(effect, 0.0) + real * one.probability
        return dict(sorted(found.items(), key=lambda pair: -pair[1]))

    @property
    def none(self) -> float:
        """Probability that no effect matters and there is nothing else."""
        return sum(w.probability for w in self.weighed if not w.named and not w.unnamed)

    @property
    def something_else(self) -> float:
        """Probability that something without a name is there."""
        return sum(w.probability for w in self.weighed if w.unnamed)

    def without(self, effect: str) -> Posterior:
        """Rules an effect out: in its explanations, something else takes its place."""
        return Posterior(
            tuple(
                replace(w, matters={e: p for e, p in w.matters.items() if e != effect}, unnamed=True)
                if effect in w.matters
                else w
                for w in self.weighed
            )
        )


def posterior(
    pool: Sequence[ExplanationEvidence], held_rows: int, others: Sequence[SomethingElse] = ()
) -> Posterior:
    """The probabilities of a pool that holds the empty explanation.

    held_rows: number of held-out rows. others: of explanations in the pool.
    """
    none = next(e for e in pool if not e.effects)
    variance = coarsened(pool)
    scale = COARSE_HELD * max(1.0, min(e.held for e in pool) / held_rows) if held_rows else 1.0
    logs = [
        -0.5 * (e.cost - none.cost) / variance
        - 0.5 * (e.held - none.held) / scale
        + sum(min(log(w * sqrt(variance)), 0.0) for w in e.widths)
        - log(e.tries)
        + (FIRST + FURTHER * (len(e.effects) - 1) if e.effects else 0.0)
        for e in pool
    ]
    gains = [_gains(e, pool) for e in pool]
    least = LEAST_GAIN * variance / COARSE
    weighed = [
        Weighed(e.effects, weight, {i: 1.0 for i in e.material if gain[i] > least})
        for e, weight, gain in zip(pool, logs, gains, strict=True)
    ]
    for other in others:
        k = next(n for n, e in enumerate(pool) if e.effects == other.effects)
        evidence = np.array([f.evidence(variance) for f in other.families])
        power = float(np.logaddexp.reduce(POWER * evidence - 0.5 * other.held / scale))
        rest = KEPT * 2.0 * variance * float(np.max(evidence))
        real = {i: 1.0 / (1.0 + (rest / gains[k][i]) ** 2) for i in weighed[k].matters}
        weighed.append(Weighed(other.effects, logs[k] + ELSE + power, real, True))
    largest = max(w.probability for w in weighed)
    total = sum(exp(w.probability - largest) for w in weighed)
    found = [replace(w, probability=exp(w.probability - largest) / total) for w in weighed]
    return Posterior(tuple(sorted(found, key=lambda w: -w.probability)))


def coarsened(pool: Sequence[ExplanationEvidence]) -> float:
    """Variance of a row in the tempered likelihood."""
    return COARSE * max(1.0, min(e.variance for e in pool))


def _gains(e: ExplanationEvidence, pool: Sequence[ExplanationEvidence]) -> dict[str, float]:
    """{effect: drop of the cost by it, against the pool's best explanation without it}."""
    return {
        i: max(min(o.cost for o in pool if o.effects <= e.effects - {i}) - e.cost, 0.0) for i in e.effects
    }


def evidence_of(e: Fitted, held: float, length: float, runs: int) -> ExplanationEvidence:
    """The numbers of a fitted explanation. held: see the class; length: of a run [s]; runs: their number."""
    errors, laws = standard_errors(e), [e.model.law(name) for name in e.model.effects]
    widths = {
        law.coordinate_name(p): length if p.name == "t" else WIDTH * p.size * p.per
        for law in laws
        for p in law.parameters
    }
    return ExplanationEvidence(
        e.effects,
        e.cost,
        e.data_cost,
        e.rows.size,
        held,
        prod(len(e.model.laws(law.id)) * (runs if law.in_one_run else 1) for law in laws),
        tuple(max(errors[n] * SPAN / w, 1e-12) for n, w in widths.items() if n in errors),
        frozenset(i for i in e.effects if is_material(i, e.model, e.x)),
    )


def standard_errors(fitted: Fitted) -> dict[str, float]:
    """{coordinate: standard deviation} at a row variance of 1; at a bound: the decay length."""
    normal = fitted.jacobian.T @ fitted.jacobian + np.diag(prior_information(fitted.free) + WEAK)
    inside = np.flatnonzero(fitted.inside & np.array([c.step > 0 for c in fitted.free]))
    spread = np.sqrt(np.diag(np.linalg.inv(normal[np.ix_(inside, inside)])))
    free = [fitted.free[k] for k in inside]
    found = {c.name: float(s) * c.scale for c, s in zip(free, spread, strict=True)}
    for k, c in enumerate(fitted.free):
        if c.name not in found:
            slope = abs(float(fitted.jacobian[:, k] @ fitted.rows)) / c.scale
            found[c.name] = min(1.0 / slope, HUGE) if slope > 0.0 else HUGE
    return found
