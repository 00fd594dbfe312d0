"""Evidence for something without a name: a curve over one quantity, or a resonance, at one place.

A family has the columns S (rows, k), what its curve's points add to the whitened rows, and the prior
c ~ N(0, lambda^2 K), K^-1 the penalty on second differences. The log of the marginal likelihood over that
without the family, with the nominal coordinates refitted (P), is

    -1/2 ln det(I + lambda^2 L^T A L) + 1/2 b^T L (I/lambda^2 + L^T A L)^-1 L^T b
    with A = S^T P S/v, b = S^T P r/v

with K = L L^T and lambda where it is largest (type-II maximum likelihood: MacKay 1992, Tipping 2001). A
resonance of a hidden state (a load that swings, a mast that sways, a linkage that gives) has two columns at
each frequency, the resonator's displacement and its velocity; their shares are the coupling and its phase.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.posterior.curve_families import groups, unit_spectra
from rover_sweep.diagnosis.posterior.transfers import RunTransfers, added_rows, transfers
from rover_sweep.diagnosis.problem.least_squares import WEAK, Fitted, prior_information, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.search.candidate_fits import tangent
from rover_sweep.diagnosis.simulation.table_law import TableLaw, resonator

LAMBDAS = np.geomspace(1e-3, 1e3, 25)  # over the size at which a family adds a row's standard deviation
LEVEL = 0.02  # of the prior's penalty on the points themselves, over that on second differences
RESONANCES = 0.5 * 2.0 ** (0.5 * np.arange(9))  # Hz
DAMPING = 0.15  # ratio
DRIVEN_BY = {  # place: what moves a resonator there; no gyro resonates below 10 Hz
    "steering": "delta",
    "side force": "a_y",
    "yaw moment": "r",
    "roll moment": "a_y",
    "sensor of ay": "signal",
}


@dataclass(frozen=True, eq=False)
class UnnamedFamily:
    """law: its place and quantity. a (k, k), b (k,): information and score outside the nominal model's
    reach, at a variance of 1 of the rows. moved (m, k): what the nominal coordinates do, in their scales, for
    1 of each point."""

    law: TableLaw
    a: Array
    b: Array
    moved: Array

    def evidence(self, variance: float) -> float:
        """ln of the marginal likelihood with the family over that without, at a variance of the rows."""
        return self._best(variance)[0]

    def amounts(self, variance: float) -> Array:
        """The coefficients (k,), at the prior's best width."""
        return self._best(variance)[1]

    def prior_root(self, variance: float) -> Array:
        """(k, k) L with the prior's covariance L L^T of the coefficients, at its best width."""
        return self._best(variance)[2]

    def _best(self, variance: float) -> tuple[float, Array, Array]:
        k = self.b.size
        bend = np.diff(np.eye(k), n=2, axis=0) if self.law.memory != "resonance" else np.zeros((0, k))
        root = np.linalg.inv(np.linalg.cholesky(LEVEL * np.eye(k) + bend.T @ bend)).T
        values, vectors = np.linalg.eigh(root.T @ self.a @ root / variance)
        values = np.maximum(values, 0.0)
        if values[-1] < 1e-12:
            return 0.0, np.zeros(k), np.zeros((k, k))
        along = vectors.T @ root.T @ self.b / variance
        width = (LAMBDAS**2 / values[-1])[:, None]
        left = 1.0 + width * values
        found = np.sum(-0.5 * np.log(left) + 0.5 * along**2 * width / left, axis=1)
        best = int(np.argmax(found))
        amounts = root @ (vectors @ (along * width[best] / left[best]))
        return max(float(found[best]), 0.0), np.asarray(amounts), root * float(np.sqrt(width[best, 0]))


def families(problem: Problem, fitted: Fitted) -> list[UnnamedFamily]:
    """Every family that these runs can show, in what a fit with its own Jacobian leaves."""
    found = transfers(problem.runs, fitted.structure, fitted.x)
    laws = [*groups(found), *_resonances(found)]
    every, ends = columns_of(problem, found, laws)
    space = tangent(fitted)
    left = space.outside(fitted.rows)[: space.rows]
    prior = np.diag(prior_information(fitted.free, absent=WEAK))
    normal = fitted.jacobian.T @ fitted.jacobian + prior
    moved = -np.linalg.solve(normal, fitted.jacobian.T @ every)
    reach, score = space.q[: space.rows].T @ every, every.T @ left
    out = []
    for law, begin, end in zip(laws, [0, *ends], ends, strict=False):
        part, inside = every[:, begin:end], reach[:, begin:end]
        a = part.T @ part - inside.T @ inside
        out.append(UnnamedFamily(law, np.asarray(a), score[begin:end], np.asarray(moved)[:, begin:end]))
    return out


def held_out_costs(
    held: Problem, fitted: Fitted, chosen: Sequence[UnnamedFamily], variance: float
) -> tuple[float, list[float]]:
    """(sum of squares of a held-out run's rows, the same with each family), to first order."""
    here = replace(fitted, rows=held.measured - held.model(fitted.structure, fitted.x))
    jacobian = sensitivities(held, here).jacobian
    found = transfers(held.runs, fitted.structure, fitted.x)
    every, ends = columns_of(held, found, [f.law for f in chosen])
    out = []
    for f, begin, end in zip(chosen, [0, *ends], ends, strict=False):
        rows = here.rows - (every[:, begin:end] + jacobian @ f.moved) @ f.amounts(variance)
        out.append(float(rows @ rows))
    return float(here.rows @ here.rows), out


def _resonances(found: Sequence[RunTransfers]) -> Iterator[TableLaw]:
    for place in found[0].responses:
        for f in RESONANCES if place in DRIVEN_BY else ():
            yield resonator(place, DRIVEN_BY[place], float(f), DAMPING)


def columns_of(
    problem: Problem, found: Sequence[RunTransfers], laws: Sequence[TableLaw]
) -> tuple[Array, list[int]]:
    """(rows (size, k) of the points of all laws in the metric, end of each law's columns)."""
    known: dict[TableLaw, list[list[Any]]] = {}
    plain, ends, columns = problem.plain, [], []
    for law in laws:
        # the same signal acts at several places
        key = replace(law, place=law.place if law.place.startswith("sensor") else "")
        if key not in known:
            known[key] = unit_spectra(law, found)
        columns += [added_rows(plain, found, law.place, one) for one in known[key]]
        ends.append(len(columns))
    return problem.of_columns(np.column_stack(columns)), ends
