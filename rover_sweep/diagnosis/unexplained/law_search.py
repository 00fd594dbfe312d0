"""The laws of something without a name: the families with the largest evidence, fitted in the simulation.

A family is chosen in the metric of what every rover has, and fitted with the nominal coordinates under its
own prior, whose width the evidence has set. What it leaves may hold another family, with which all are fitted
again. The evidence of the families at one place, summed, is what that place explains; places that share it
are alternatives. Runs that are held out judge the laws and choose nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects import Effect
from rover_sweep.diagnosis.held_out.worth import EXPLAINABLE
from rover_sweep.diagnosis.posterior.model_fit import ModelFit
from rover_sweep.diagnosis.posterior.unnamed import UnnamedFamily, families
from rover_sweep.diagnosis.posterior.weights import POWER
from rover_sweep.diagnosis.problem.least_squares import (
    COARSE,
    WEAK,
    Fitted,
    fit,
    prior_information,
    sensitivities,
)
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.result import LawHeldOut
from rover_sweep.diagnosis.simulation.nominal import Coordinate
from rover_sweep.diagnosis.simulation.table_law import TableLaw, law_at, law_effect

MOST = 3  # laws
LEAST = 5.0  # ln of the evidence from which there is a law
SHARE = 0.15  # probability from which another place is an alternative
REMOVED = 0.2  # least share of the held-out residual above the floor that the laws remove
SPREAD = 2.5  # standard deviations within which they are fitted
SHARES = (1.0, 0.3, 0.1, 0.0)  # of the linear prediction; a law acts on what drives it, so it may be far off
RESONATOR = {"size": 0.2, "damping": 0.7}  # standard deviations of ln frequency, half a step, and ln damping


@dataclass(frozen=True, eq=False)
class FoundLaw:
    """A law that was fitted. alternatives: other places that explain nearly as much.

    name, root: `law_at` gives it at coordinates from `law`, which has y = 0. gain: drop of the cost by it.
    """

    law: TableLaw
    alternatives: tuple[str, ...]
    gain: float
    name: str
    root: Array

    def at(self, x: Mapping[str, float]) -> TableLaw:
        """The law at the coordinates x of the model."""
        return law_at(self.law, self.name, self.root, x)


@dataclass(frozen=True, eq=False)
class FoundLaws:
    """All laws, the most probable one first. fitted: the model with them, on the rows of the used runs."""

    laws: tuple[FoundLaw, ...]
    fitted: Fitted
    held_out: tuple[LawHeldOut, ...] = ()

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The laws as effects, on top of those of the model."""
        return self.fitted.structure.effects[-len(self.laws) :]

    @property
    def share_removed(self) -> float | None:
        """Share of the held-out residual above the floor that they remove; None where no run can judge it."""
        judged = [h for h in self.held_out if h.share_left is not None]
        before, after = (
            sum(v - 1.0 for v in vs) for vs in ([h.before for h in judged], [h.after for h in judged])
        )
        return 1.0 - after / before if judged else None

    @property
    def holds(self) -> bool:
        """True where they remove enough of the held-out residual and make no run worse."""
        share = self.share_removed
        worse = any(h.after > max(h.before, EXPLAINABLE) for h in self.held_out)
        return not worse and (share is None or share >= REMOVED)


def find_laws(
    last: ModelFit, held_out: Mapping[str, Problem], known: Sequence[UnnamedFamily] = ()
) -> FoundLaws | None:
    """The families that explain what a model leaves, None where none has evidence.

    held_out: {run: its problem}. known: the families of what the model leaves, where they were computed.
    """
    metric, plain = last.problem, last.problem.plain
    base = sensitivities(plain, last.closest)
    variance = COARSE * last.fitted.overdispersion
    every = known or families(metric, last.fitted)
    fitted, found = base, list[FoundLaw]()
    while len(found) < MOST:
        best = max(every, key=lambda f: f.evidence(variance))
        if best.evidence(variance) < LEAST:
            break
        law, after = _with(plain, fitted, best, f"law{len(found) + 1}", base.overdispersion)
        found.append(replace(law, alternatives=_places(every, variance, best)))
        fitted = after
        if len(found) < MOST:
            left = replace(fitted, rows=metric.of(fitted.rows), jacobian=metric.of(fitted.jacobian))
            every = [f for f in families(metric, left) if f.law.kind not in {one.law.kind for one in found}]
    if not found:
        return None
    return FoundLaws(tuple(found), fitted, tuple(_judged(n, p, base, fitted) for n, p in held_out.items()))


def _with(
    problem: Problem, base: Fitted, best: UnnamedFamily, name: str, variance: float
) -> tuple[FoundLaw, Fitted]:
    """A family fitted with all that a model has: (the law, the model with its own Jacobian)."""
    root = best.prior_root(variance)
    start = np.linalg.lstsq(root, best.amounts(variance))[0]
    free = [Coordinate(f"{name}.z{k}", 0.0, -np.inf, np.inf, 1.0, np.sqrt(COARSE)) for k in range(start.size)]
    if best.law.memory == "resonance":
        free += [Coordinate(f"{name}.{n}", 0.0, -SPREAD * s, SPREAD * s, s, s) for n, s in RESONATOR.items()]
    effect = law_effect(best.law, base.structure.rover, name, root)
    structure = replace(base.structure, effects=(*base.structure.effects, effect))
    for share in SHARES:
        x = {**base.x, **{c.name: share * float(z) for c, z in zip(free, start, strict=False)}}
        rows = problem.measured - problem.model(structure, x)
        if rows @ rows < base.cost:
            break
    found = fit(problem, structure, (*base.free, *free), x, steps=5, known=base, tolerance=5e-4 * base.cost)
    return FoundLaw(best.law, (), base.cost - found.cost, name, root), sensitivities(problem, found)


def _places(every: Sequence[UnnamedFamily], variance: float, best: UnnamedFamily) -> tuple[str, ...]:
    """The other places with a share of the probability, the most probable one first."""
    logs = np.array([POWER * f.evidence(variance) for f in every])
    weights = np.exp(logs - logs.max())
    share: dict[str, float] = {}
    for f, w in zip(every, weights / weights.sum(), strict=True):
        share[f.law.place] = share.get(f.law.place, 0.0) + float(w)
    others = [p for p in share if p != best.law.place and share[p] >= SHARE]
    return tuple(sorted(others, key=lambda p: -share[p]))


def _judged(name: str, held: Problem, base: Fitted, best: Fitted) -> LawHeldOut:
    before, after = (
        float(np.mean((held.measured - held.model(f.structure, f.x)) ** 2)) for f in (base, best)
    )
    share = (after - 1.0) / (before - 1.0) if before > EXPLAINABLE else None
    return LawHeldOut(name, before, after, share)


def drawn_laws(found: FoundLaws, one: FoundLaw, number: int, seed: int) -> list[TableLaw]:
    """The law with coordinates drawn from the posterior, the noise scaled to the residual that is left."""
    fitted = found.fitted
    normal = fitted.jacobian.T @ fitted.jacobian / fitted.overdispersion
    covariance = np.linalg.inv(normal + np.diag(prior_information(fitted.free, absent=WEAK)))
    own = [k for k, c in enumerate(fitted.free) if c.name.startswith(f"{one.name}.")]
    random = np.random.default_rng(seed)
    moves = random.multivariate_normal(np.zeros(len(own)), covariance[np.ix_(own, own)], number, method="svd")
    names, scales = [fitted.free[k].name for k in own], [fitted.free[k].scale for k in own]
    at = [fitted.x[n] for n in names]
    return [one.at(dict(zip(names, at + scales * move, strict=True))) for move in moves]
