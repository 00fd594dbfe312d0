"""Group-wise forward selection of laws: orthogonal matching pursuit with cross-validation.

The rows of the residual are divided into two halves of blocks of neighbouring lines. On the first half a
group is scored by blocks that its fit did not use: the drop of the residual there, against the nominal model
as it is or refitted in the same way, whichever is better. The second half, which chose nothing, confirms it.
The nominal coordinates with their priors are refitted with each group, so that no group gets credit for what
they explain.

Group-wise matching: Majumdar and Ward 2009. pysindy and group-lasso packages regress measured derivatives on
functions of measured states. Here the angle behind the servo, the tyre forces and the filtered motion are not
measured, so that the columns must be simulated rows; with them, small normal equations are all that remains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.problem.least_squares import Fitted
from rover_sweep.diagnosis.problem.residuals import Problem

BLOCK = 8  # neighbouring lines that belong together, since the taper correlates them
FOLDS = 3  # of the half that chooses
RIDGE = 1e-5  # of a group's mean diagonal: holds points that no run visited
BEND = 1e-4  # the same of the second differences along the curve


@dataclass(frozen=True, eq=False)
class Cells:
    """Rows by half (0: chooses, 1: confirms) and fold. index (size,): 2 fold + half."""

    index: NDArray[np.intp]

    @staticmethod
    def of(problem: Problem) -> Cells:
        """Blocks of lines alternate between the halves, and within a half between the folds.

        Runs are no folds: a curve over an amplitude that one run alone reached cannot predict that run.
        """
        index = np.zeros(problem.size, np.intp)
        for r in problem.rows:
            block = np.tile(np.arange(r.bins.size) // BLOCK, 2)
            index[r.start : r.start + r.size] = 2 * (block // 2 % FOLDS) + block % 2
        return Cells(index)


@dataclass(frozen=True, eq=False)
class Grams:
    """Normal equations of columns (size, k) and the residual by cell.

    a (cells, k, k), b (cells, k): products of the columns with each other and with the residual.
    """

    a: Array
    b: Array

    def of(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """(a, b) of the cells chosen."""
        rows = list(chosen)
        return self.a[rows].sum(axis=0), self.b[rows].sum(axis=0)


@dataclass(frozen=True, eq=False)
class Score:
    """Drops of the residual by a group: chosen, by folds of the first half; confirmed, on the second."""

    chosen: float
    confirmed: float

    @property
    def total(self) -> float:
        """Both together."""
        return self.chosen + self.confirmed


@dataclass(frozen=True, eq=False)
class Regression:
    """The residual of a fit and what the nominal coordinates, and groups taken before, can explain of it.

    columns (size, m); weight (m, m): of their priors; pull (m,): right side of the priors.
    """

    cells: Cells
    residual: Array
    columns: Array
    weight: Array
    pull: Array

    @staticmethod
    def of(problem: Problem, fitted: Fitted) -> Regression:
        """The nominal coordinates that are inside their bounds."""
        inside = [
            k
            for k, c in enumerate(fitted.free)
            if c.low + 1e-6 * c.scale < fitted.x[c.name] < c.high - 1e-6 * c.scale
        ]
        free = [fitted.free[k] for k in inside]
        weight = np.array([(c.scale / c.prior) ** 2 if c.prior else 1e-9 for c in free])
        away = np.array([(c.start - fitted.x[c.name]) / c.scale if c.prior else 0.0 for c in free])
        return Regression(
            Cells.of(problem), fitted.rows, fitted.jacobian[:, inside], np.diag(weight), weight * away
        )

    def with_group(self, rows: Array) -> Regression:
        """This regression with a group's rows (size, k) taken."""
        n, k = self.columns.shape[1], rows.shape[1]
        weight = np.zeros((n + k, n + k))
        weight[:n, :n] = self.weight
        weight[n:, n:] = _smooth(rows)
        pull = np.concatenate((self.pull, np.zeros(k)))
        return Regression(self.cells, self.residual, np.column_stack((self.columns, rows)), weight, pull)

    def amounts(self) -> Array:
        """The coefficients (m,) of all columns, fitted to all rows."""
        a = self.columns.T @ self.columns + self.weight
        return np.asarray(np.linalg.solve(a, self.columns.T @ self.residual + self.pull), np.float64)

    def score(self, rows: Array) -> Score:
        """The score of one more group with rows (size, k)."""
        more = self.with_group(rows)
        without, with_group = _grams(self), _grams(more)
        chooses = [2 * f for f in range(FOLDS)]
        confirms = [c + 1 for c in chooses]
        chosen = 0.0
        for test in chooses:
            train = [c for c in chooses if c != test]
            chosen += min(_left(self, without, train, [test]), 0.0) - _left(more, with_group, train, [test])
        confirmed = min(_left(self, without, chooses, confirms), 0.0)
        confirmed -= _left(more, with_group, chooses, confirms)
        return Score(chosen, confirmed)


def _grams(of: Regression) -> Grams:
    a, b = [], []
    for cell in range(2 * FOLDS):
        rows = of.cells.index == cell
        part = of.columns[rows]
        a.append(part.T @ part)
        b.append(part.T @ of.residual[rows])
    return Grams(np.array(a), np.array(b))


def _left(of: Regression, grams: Grams, train: Sequence[int], test: Sequence[int]) -> float:
    """Sum of squares in the test cells, minus a constant, by coefficients fitted to the train cells."""
    a, b = grams.of(train)
    h = np.linalg.solve(a + of.weight, b + of.pull)
    ta, tb = grams.of(test)
    return float(h @ ta @ h - 2 * h @ tb)


def _smooth(rows: Array) -> Array:
    """Penalty (k, k) on the amounts and the second differences of a group's points."""
    k = rows.shape[1]
    size = float(np.sum(rows * rows)) / k + 1e-12
    bend = np.diff(np.eye(k), n=2, axis=0)
    return np.asarray(size * (RIDGE * np.eye(k) + BEND * bend.T @ bend))
