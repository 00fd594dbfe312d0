"""A law fitted in the simulation itself, together with the nominal coordinates: its curve and its band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.least_squares import WEAK, Fitted, fit, prior_information, sensitivities
from rover_sweep.diagnosis.problem.residuals import Problem
from rover_sweep.diagnosis.simulation.nominal import Coordinate
from rover_sweep.diagnosis.simulation.table_law import TableLaw, with_laws

WIDE = 10.0  # prior of a point, in sizes of the curve: it holds points that no run visited
Z90 = 1.645  # half width of a 90 % interval in standard deviations
STEPS = 5
ENOUGH = 5e-4  # drop of the cost, as a share of it, that ends a fit


@dataclass(frozen=True, eq=False)
class FittedLaws:
    """Laws fitted together with the nominal coordinates. fitted: on the rows of the used runs."""

    laws: tuple[TableLaw, ...]
    fitted: Fitted


def fit_laws(
    problem: Problem, base: Fitted, laws: Sequence[TableLaw], start: Sequence[Array], known: bool = False
) -> FittedLaws:
    """The laws fitted from the amounts `start` of their points. known: keep the base's Jacobian."""
    structure = with_laws(base.structure, laws)
    free, x = list(base.free), dict(base.x)
    for k, (law, amounts) in enumerate(zip(laws, start, strict=True)):
        size = float(np.max(np.abs(amounts))) or 1e-6
        for j in range(len(law.y)):
            name = f"law{k + 1}.y{j}"
            free.append(Coordinate(name, 0.0, -np.inf, np.inf, size, WIDE * size))
            x[name] = float(amounts[j])
    found = fit(
        problem, structure, free, x, steps=STEPS, known=base if known else None, tolerance=ENOUGH * base.cost
    )
    done = tuple(
        replace(law, y=tuple(found.x[f"law{k + 1}.y{j}"] for j in range(len(law.y))))
        for k, law in enumerate(laws)
    )
    return FittedLaws(done, found)


def curves(problem: Problem, found: FittedLaws) -> list[tuple[Array, Array]]:
    """(y (k,), half width (k,) of its 90 % interval) of each law, relative to its reference.

    The reference is the value at x = 0, or the mean where the range does not hold 0: a constant is not
    separable from trim, biases and stiffness. The noise is scaled to the residual that is left.
    """
    fresh = sensitivities(problem, found.fitted)
    weight = prior_information(fresh.free, absent=WEAK)
    covariance = np.linalg.inv(fresh.jacobian.T @ fresh.jacobian + np.diag(weight)) * fresh.overdispersion
    names = [c.name for c in fresh.free]
    scale = np.array([c.scale for c in fresh.free])
    out = []
    for k, law in enumerate(found.laws):
        at = [names.index(f"law{k + 1}.y{j}") for j in range(len(law.y))]
        part = covariance[np.ix_(at, at)] * np.outer(scale[at], scale[at])
        shifted = np.eye(len(at)) - _reference(np.array(law.x))[None, :]
        out.append((shifted @ np.array(law.y), Z90 * np.sqrt(np.diag(shifted @ part @ shifted.T))))
    return out


def _reference(x: Array) -> Array:
    """Weights (k,) of the points in the reference value."""
    if not x[0] < 0.0 < x[-1]:
        return np.full(x.size, 1.0 / x.size)
    return np.array([np.interp(0.0, x, one) for one in np.eye(x.size)])
