"""The days of a vehicle as a linear model with scatter from day to day.

The coordinates of day d are x_d = m_d + u_d with m_d = mu + sum_j c_j g_j(d) b_j: mu common to all days, c_j
the size of change j along b_j with the time shape g_j, and u_d ~ N(0, diag(s^2)) that no interval of a day
explains (surface, temperature, load). With the quadratic likelihoods D_d, h_d of the days, u_d integrates out
in closed form:

    W_d = D_d - D_d V_d D_d,   V_d = (D_d + diag(1/s^2))^-1

s^2 is estimated by expectation maximisation with an inverse-gamma prior about what is usual (Dempster, Laird
and Rubin 1977; Searle, Casella and McCulloch 1992, Variance Components).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array

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


def with_usual(days: Days, usual: Array) -> Days:
    """The days with another usual scatter."""
    return replace(days, usual=usual)


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
