"""The changes of a vehicle over its days: which quantity, when, how large; one at a time.

For each quantity q (direction b in the coordinates) and each time shape g (a step before a day, a ramp from a
day on, one odd day), the score test of the model without it gives the drop of chi-squared in closed form:

    gain = (b^T z)^2/(b^T S b),  z = sum_d g_d s_d,
    S = sum_d g_d^2 W_d - A (sum_d W_d + P)^-1 A^T,  A = sum_d g_d W_d

The best shapes of the best quantities are then fitted with a scatter of their own, and the most likely one is
added where its size over its standard deviation exceeds the threshold of Student's distribution for the
number of all tests of the season (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.stats import t as student

from rover_sweep.comparison.quantities import Comparable
from rover_sweep.data.recording import Array
from rover_sweep.season.scatter import USUAL_WEIGHT, Days, Explained, Term, explained

FALSE_ALARM = 0.01  # of a whole season
TRIED = 5  # quantities that are fitted in each round
WORTH = 15.0  # gain with the usual scatter from which a change is fitted; the threshold is never lower
MOST = 6  # changes of one vehicle
FEWEST = 4  # days; fewer show no drift
SIDE = 2  # days before and after a step, so that one odd day is no change
ALIKE = 0.8  # share of a quantity's gain from which another one is a look-alike
PROFILE = 1.92  # drop of the log likelihood at the end of a 95 % interval


@dataclass(frozen=True, eq=False)
class Shape:
    """A course in time (n,), 0 before and 1 at the end. at: index of the first day after a step, of the last
    day before a ramp begins, or of the odd day."""

    kind: Literal["step", "gradual", "day"]
    at: int
    course: Array


@dataclass(frozen=True, eq=False)
class FoundChange:
    """A quantity's change. size: along its direction, with standard deviation sd. ratio: size/sd when it was
    added. possible: `at` of all shapes of its kind within the 95 % interval. look_alikes: others."""

    quantity: int
    shape: Shape
    size: float
    sd: float
    ratio: float
    possible: tuple[int, ...]
    look_alikes: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class VehicleTests:
    """What is tested on one vehicle. times (n,): days as numbers; quantities with directions (k, q)."""

    days: Days
    times: Array
    quantities: tuple[Comparable, ...]
    directions: Array

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Steps with `SIDE` days on both sides, ramps over at least `SIDE` days, and each day alone."""
        n = self.times.size
        steps = [Shape("step", i, (np.arange(n) >= i).astype(float)) for i in range(SIDE, n - SIDE + 1)]
        ramps = [Shape("gradual", i, _ramp(self.times, i)) for i in range(n - SIDE)]
        days = [Shape("day", i, row) for i, row in enumerate(np.eye(n))]
        return (*steps, *ramps, *days)

    @property
    def count(self) -> int:
        """Number of tests, 0 where there are too few days."""
        return len(self.shapes) * len(self.quantities) if self.times.size >= FEWEST else 0

    def term(self, quantity: int, shape: Shape) -> Term:
        """A change as a term of the linear model."""
        return self.directions[:, quantity], shape.course


def _ramp(times: Array, i: int) -> Array:
    return np.asarray(np.clip((times - times[i]) / (times[-1] - times[i]), 0.0, 1.0))


def changes_of(vehicle: VehicleTests, tests: int) -> tuple[tuple[FoundChange, ...], Explained]:
    """(changes in the order of their discovery, the days explained with them). tests: of the whole season."""
    found: list[FoundChange] = []
    terms: list[Term] = []
    now = explained(vehicle.days, terms)
    while vehicle.count and len(found) < MOST:
        new = _next(vehicle, terms, tests)
        if new is None:
            break
        found.append(new)
        terms.append(vehicle.term(new.quantity, new.shape))
        now = explained(vehicle.days, terms)
    return tuple(_with_sizes(found, now)), now


def _with_sizes(found: Sequence[FoundChange], last: Explained) -> list[FoundChange]:
    sd = np.sqrt(np.diag(last.covariance))
    return [replace(c, size=float(s), sd=float(e)) for c, s, e in zip(found, last.sizes, sd, strict=True)]


def _next(vehicle: VehicleTests, terms: Sequence[Term], tests: int) -> FoundChange | None:
    """The most likely further change, None where none is significant."""
    gains = _gains(vehicle, explained(vehicle.days, terms, vehicle.days.usual))  # (shapes, quantities)
    most = gains.max(axis=0)
    best = np.argsort(-most, kind="stable")[:TRIED]
    fits = []
    for q in best[most[best] > WORTH].tolist():
        shape = vehicle.shapes[int(gains[:, q].argmax())]
        fits.append((explained(vehicle.days, [*terms, vehicle.term(q, shape)]), q, shape))
    if not fits:
        return None
    fit, q, shape = max(fits, key=lambda f: f[0].log_likelihood)
    ratio = float(fit.sizes[-1] / np.sqrt(fit.covariance[-1, -1]))
    freedom = USUAL_WEIGHT + vehicle.times.size - 1 - fit.sizes.size
    if 2.0 * student.sf(abs(ratio), freedom) * max(tests, 1) > FALSE_ALARM:
        return None
    others = [other for other in np.flatnonzero(most > ALIKE * most[q]).tolist() if other != q]
    possible = _possible(vehicle, terms, q, shape, fit)
    return FoundChange(q, shape, 0.0, 0.0, ratio, possible, tuple(others))


def _gains(vehicle: VehicleTests, now: Explained) -> Array:
    """Score tests (shapes, quantities)."""
    out = np.zeros((len(vehicle.shapes), vehicle.directions.shape[1]))
    inverse = np.linalg.inv(now.curvature)
    b = vehicle.directions
    for i, shape in enumerate(vehicle.shapes):
        g = shape.course
        a = np.tensordot(g, now.weight, 1)
        s = np.tensordot(g * g, now.weight, 1) - a @ inverse @ a.T
        information = np.maximum(np.sum(b * (s @ b), axis=0), 1e-300)
        out[i] = (b.T @ (g @ now.score)) ** 2 / information
    return out


def _possible(
    vehicle: VehicleTests, terms: Sequence[Term], q: int, best: Shape, fit: Explained
) -> tuple[int, ...]:
    """`at` of the shapes of the same kind that are nearly as likely, with the best one's scatter."""
    found = []
    for shape in vehicle.shapes:
        if shape.kind == best.kind:
            other = explained(vehicle.days, [*terms, vehicle.term(q, shape)], fit.scatter)
            if other.log_likelihood >= fit.log_likelihood - PROFILE:
                found.append(shape.at)
    return tuple(sorted({*found, best.at}))
