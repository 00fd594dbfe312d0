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

from rover_sweep.comparison.differences import Comparable
from rover_sweep.data.recording import Array
from rover_sweep.season.season_result import Drift, Season

# The days of a vehicle as a linear model with scatter from day to day.
#
# The coordinates of day d are x_d = m_d + u_d with m_d = mu + sum_j c_j g_j(d) b_j: mu common to all days,
# c_j the size of change j along b_j with the time shape g_j, and u_d ~ N(0, diag(s^2)) that no interval of a
# day explains (surface, temperature, load). With the quadratic likelihoods D_d, h_d of the days, u_d
# integrates out in closed form:
#
#     W_d = D_d - D_d V_d D_d,   V_d = (D_d + diag(1/s^2))^-1
#
# s^2 is estimated by expectation maximisation with an inverse-gamma prior about what is usual (Dempster,
# Laird and Rubin 1977; Searle, Casella and McCulloch 1992, Variance Components).


ROUNDS = 15
USUAL_WEIGHT = 6.0  # days that the usual scatter counts as
Term = tuple[Array, Array]  # (direction b (k,), time shape g (n,))


@dataclass(frozen=True, eq=False)
class Days:
    """The days of a vehicle. information (n, k, k), linear (n, k); prior (k,): 1/variance of mu about
    `centre` (k,); usual (k,): variance that the scatter usually has."""

    information: Array
    linear: Array
    prior: Array
    centre: Array
    usual: Array


@dataclass(frozen=True, eq=False)
class Explained:
    """A vehicle's days with changes. means (n, k): m_d. sizes (m,), covariance (m, m): of the changes.

    scatter (k,): s^2, and `next_scatter` (k,) of a further round of its estimation. weight (n, k, k): W_d.
    score (n, k): of the residual, dlogL/dm_d. curvature (k, k): of mu. log_likelihood: marginal, with the
    prior of the scatter.
    """

    means: Array
    sizes: Array
    covariance: Array
    scatter: Array
    next_scatter: Array
    weight: Array
    score: Array
    curvature: Array
    log_likelihood: float


def explained(days: Days, terms: Sequence[Term], scatter: Array | None = None) -> Explained:
    """The best mu and sizes. scatter (k,): s^2 to use; None estimates it."""
    if scatter is not None:
        return _solved(days, terms, scatter)
    found = _solved(days, terms, days.usual)
    for _ in range(ROUNDS):
        found = _solved(days, terms, found.next_scatter)
    return found


def _solved(days: Days, terms: Sequence[Term], s2: Array) -> Explained:
    n, k = days.linear.shape
    v = np.linalg.inv(days.information + np.diag(1.0 / s2))
    dv = days.information @ v
    weight = days.information - dv @ days.information
    right = days.linear - (dv @ days.linear[:, :, None])[:, :, 0]
    design = np.zeros((n, k, k + len(terms)))
    design[:, :, :k] = np.eye(k)
    for j, (b, g) in enumerate(terms):
        design[:, :, k + j] = g[:, None] * b
    weighted = weight @ design
    normal = np.sum(np.swapaxes(design, 1, 2) @ weighted, axis=0)
    normal[range(k), range(k)] += days.prior
    wanted = np.sum(np.swapaxes(design, 1, 2) @ right[:, :, None], axis=0)[:, 0]
    wanted[:k] += days.prior * days.centre
    inverse = np.linalg.inv(normal)
    theta = inverse @ wanted
    means = design @ theta
    score = right - (weight @ means[:, :, None])[:, :, 0]
    mu = theta[:k]
    inside = days.linear - (days.information @ means[:, :, None])[:, :, 0]
    value = np.sum(days.linear * means) - 0.5 * np.sum(means * (days.linear - inside))
    u = (v @ inside[:, :, None])[:, :, 0]  # expected u_d
    value += 0.5 * np.sum(inside * u)
    value += 0.5 * np.sum(np.linalg.slogdet(v)[1]) - 0.5 * n * np.sum(np.log(s2))
    value -= 0.5 * np.sum(days.prior * (mu - days.centre) ** 2)
    value -= 0.5 * USUAL_WEIGHT * np.sum(np.log(s2 / days.usual) + days.usual / s2)
    squares = np.sum(u**2 + np.diagonal(v, axis1=1, axis2=2), axis=0)
    after = (USUAL_WEIGHT * days.usual + squares) / (USUAL_WEIGHT + n)
    return Explained(
        means, theta[k:], inverse[k:, k:], s2, after, weight, score, normal[:k, :k], float(value)
    )


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
    """Values by day (n,), 0 before and 1 at the end. at: index of the first day after a step, of the last day
    before a ramp begins, or of the odd day."""

    kind: Literal["step", "gradual", "day"]
    at: int
    course: Array


@dataclass(frozen=True, eq=False)
class FoundChange:
    """A quantity's change. size: along its direction, with standard deviation sd. ratio: size/sd when it was
    added. possible: `at` of all such shapes in the 95 % interval. look_alikes: other quantities."""

    quantity: int
    shape: Shape
    size: float
    sd: float
    ratio: float
    possible: tuple[int, ...]
    look_alikes: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class VehicleTests:
    """The tests of one vehicle. times (n,): days as numbers; quantities with directions (k, q)."""

    days: Days
    times: Array
    quantities: tuple[Comparable, ...]
    directions: Array

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Steps with `SIDE` days on both sides, ramps over at least `SIDE` days, and each day alone."""
        n = self.times.size
        steps = [Shape("step", i, (np.arange(n) >= i).astype(float)) for i in range(SIDE, n - SIDE + 1)]
        t = self.times
        courses = [np.clip((t - t[i]) / (t[-1] - t[i]), 0.0, 1.0) for i in range(n - SIDE)]
        ramps = [Shape("gradual", i, course) for i, course in enumerate(courses)]
        days = [Shape("day", i, row) for i, row in enumerate(np.eye(n))]
        return (*steps, *ramps, *days)

    @property
    def count(self) -> int:
        """Number of tests, 0 if there are too few days."""
        return len(self.shapes) * len(self.quantities) if self.times.size >= FEWEST else 0

    def term(self, quantity: int, shape: Shape) -> Term:
        """A change as a term of the linear model."""
        return self.directions[:, quantity], shape.course


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
    sd = np.sqrt(np.diag(now.covariance))
    sizes = zip(found, now.sizes, sd, strict=True)
    return tuple(replace(c, size=float(s), sd=float(e)) for c, s, e in sizes), now


def _next(vehicle: VehicleTests, terms: Sequence[Term], tests: int) -> FoundChange | None:
    """The most likely further change, None if none is significant."""
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
    """`at` of nearly as likely shapes of the same kind, with the best one's scatter."""
    found = []
    for shape in vehicle.shapes:
        if shape.kind == best.kind:
            other = explained(vehicle.days, [*terms, vehicle.term(q, shape)], fit.scatter)
            if other.log_likelihood >= fit.log_likelihood - PROFILE:
                found.append(shape.at)
    return tuple(sorted({*found, best.at}))


# The words of a season.


def drift_sentence(d: Drift, previous: str, last: str) -> str:
    """One change of a quantity in one sentence. previous: the day before d.day; last: of the season."""
    assert d.before is not None and d.after is not None and d.low is not None and d.high is not None
    unit = f" {d.unit}" if d.unit else ""
    if d.relative:
        ends = sorted((100.0 * (d.low - 1.0), 100.0 * (d.high - 1.0)))
        share = 100.0 * (d.after / d.before - 1.0)
        size = f"{share:+.0f} % (90 %: {ends[0]:+.0f} to {ends[1]:+.0f})"
    else:
        size = f"{d.after - d.before:+.3g}{unit} (90 %: {d.low:+.3g} to {d.high:+.3g})"
    values = f"from {d.before:.3g} to {d.after:.3g}{unit}"
    if d.kind == "gradual":
        begins = d.day if d.earliest == d.latest else f"{d.day} ({d.earliest} to {d.latest})"
        words = f"{d.quantity} ({d.meaning}) drifts {values} by {last}, {size}; it begins after {begins}"
    elif d.kind == "day":
        words = f"{d.quantity} ({d.meaning}) was different on {d.day} only, {values}, {size}"
    else:
        when = f"between {previous} and {d.day}"
        if d.earliest != d.latest:
            when += f" (first other day: {d.earliest} to {d.latest})"
        words = f"{d.quantity} ({d.meaning}) changed {when}, {values}, {size}"
    alike = f"; {', '.join(d.look_alikes)} would look alike" if d.look_alikes else ""
    changed = ", ".join(f"{p.name} {p.before:g} to {p.after:g}" for p in d.parameters[:5])
    more = f"; parameters that changed meanwhile: {changed}" if changed else ""
    return f"{d.vehicle}: {words}{alike}{more}"


def season_sentence(season: Season) -> str:
    """The answer in one sentence."""
    found = season.drifts
    fitted = season.logs - len(season.refused)
    of = f"{fitted} of {season.logs} logs of {len(season.vehicles)} vehicle(s)"
    left = f"; {len(season.refused)} could not be used" if season.refused else ""
    short = sum(not v.quantities for v in season.vehicles)
    if short:
        left += f"; {short} vehicle(s) with fewer than {FEWEST} days were not searched for drifts"
    if not found and short == len(season.vehicles):
        return f"no drift was searched in {of}{left}"
    if not found:
        return f"nothing drifted in {of}{left}"
    named = list(dict.fromkeys(d.vehicle for d in found))
    return f"{len(found)} change(s) on {len(named)} vehicle(s) ({', '.join(named)}) in {of}{left}"
