"""Confidence intervals of the parameters by a parametric bootstrap of the whole pipeline.

Windows cannot be resampled: they overlap by 80 %, all lengths share the same data, and a run of 55 s holds
only two independent windows of the longest length. Therefore each of B replicates b repeats the experiment:

1. y_b = model(theta^) driven by the measured steering + noise. The noise is Gaussian, with the
   cross-spectra of the fit's residuals and their slow change of level in time (`spectra.noise`).
2. y_b passes through the same windows, composite and usable-band choice as the data (`replicates`).
3. The model is fitted to the replicate's responses, from theta^ (`refit`): theta_b.

This keeps every correlation between windows, lengths, frequencies and responses. theta_b - theta^ is
distributed like theta^ - theta (Efron & Tibshirani 1993, section 6.5), so with the quantiles q of theta_b

    theta^ - theta in [q_(1-L)/2 - theta^, q_(1+L)/2 - theta^]  at level L
    theta in [2 theta^ - q_(1+L)/2, 2 theta^ - q_(1-L)/2]

the basic interval (Davison & Hinkley 1997, section 5.2), on ln(theta) for positive parameters. It removes
the bias of the method, such as the leakage of the windows. Model errors count as noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.data.intervals import LEVEL, Intervals
from rover_sweep.data.recording import Array
from rover_sweep.identification.bootstrap.refit import logarithmic, refitted_replicates
from rover_sweep.identification.bootstrap.replicates import GroupReplicator, Known
from rover_sweep.identification.cost import Condition, restricted
from rover_sweep.identification.fit import FitResult
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.structure.state_space import Parameter


class Bootstrap:
    """Replicates of the responses of these groups, shared by all models that are refitted to them.

    known: the runs' replicators of other bootstraps of the same runs, to use and to add to.
    """

    def __init__(
        self, groups: Sequence[Group], conditions: Sequence[Condition], known: Known | None = None
    ) -> None:
        found: Known = {} if known is None else known
        self.groups = [GroupReplicator(g, c, found) for g, c in zip(groups, conditions, strict=True)]

    def intervals(
        self, fit: FitResult, replicates: int = 200, level: float = LEVEL, seed: int = 0
    ) -> tuple[Intervals, ...]:
        """Intervals of the free parameters of a fit to these conditions, reproducible for a seed.

        level: coverage, 0..1. fit must be the optimum for the conditions of this bootstrap.
        """
        thetas = self.estimates(fit, replicates, seed)
        free, log = fit.structure.free, logarithmic(fit.structure)
        ok = np.all(np.isfinite(thetas), axis=1)
        return tuple(
            _interval(p, bool(log[i]), thetas[ok, i], level, int(np.sum(~ok))) for i, p in enumerate(free)
        )

    def estimates(self, fit: FitResult, replicates: int, seed: int) -> Array:
        """theta_b (replicates, n_free) in parameter units; nan in rows where the refit diverged."""
        rng = np.random.default_rng(seed)
        made = [group(fit.structure, replicates, rng) for group in self.groups]
        conditions = [restricted(g.condition, fit.structure) for g in self.groups]
        return refitted_replicates(fit.structure, conditions, made)


def _interval(p: Parameter, log: bool, theta: Array, level: float, failed: int) -> Intervals:
    """The basic interval of the module's text, widened to hold the estimate where the bias is larger.

    theta (n,): replicates; failed: number that diverged.
    """
    if theta.size < max(2, failed):
        return Intervals(p.name, np.nan, np.nan, level, np.nan, np.nan, theta.size, failed)
    x, best = (np.log(theta), np.log(p.value)) if log else (theta, p.value)
    low, high = 2 * best - np.quantile(x, [(1 + level) / 2, (1 - level) / 2])
    ends = np.exp((low, high)) if log else np.array((low, high))
    low, high = np.clip((min(ends[0], p.value), max(ends[1], p.value)), p.lower, p.upper)
    sd, bias = float(np.std(theta, ddof=1)), float(np.mean(theta) - p.value)
    return Intervals(p.name, float(low), float(high), level, sd, bias, theta.size, failed)
