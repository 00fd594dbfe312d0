"""Intervals of the parameters by a parametric bootstrap through the whole pipeline.

Windows overlap by 80 %, several lengths share the same data and one run of 55 s holds two independent
windows of the longest length, so there is nothing to resample among windows. Instead the fitted model
is driven by the measured steering, noise with the cross-spectra of the fit's own residuals is added in
the time domain, and the responses, composites and parameters are estimated again. This keeps every
correlation (between windows, lengths, neighbouring frequencies and responses) and shows the bias of
the method itself, such as the leakage of the windows, which the intervals take out (basic bootstrap
intervals, Davison & Hinkley 1997, section 5.2). What a model does not explain counts as noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.data.intervals import LEVEL, Intervals
from rover_sweep.data.recording import Array
from rover_sweep.identification.bootstrap.refit import logarithmic, refitted
from rover_sweep.identification.bootstrap.replicates import GroupReplicator
from rover_sweep.identification.cost import Condition, restricted
from rover_sweep.identification.fit import FitResult
from rover_sweep.identification.grouping import Group
from rover_sweep.identification.structure.state_space import Parameter


class Bootstrap:
    """Replicates of the responses of these groups, to which any number of models can be fitted again."""

    def __init__(self, groups: Sequence[Group], conditions: Sequence[Condition]) -> None:
        self.groups = [GroupReplicator(g, c) for g, c in zip(groups, conditions, strict=True)]

    def intervals(
        self, fit: FitResult, replicates: int = 200, level: float = LEVEL, seed: int = 0
    ) -> tuple[Intervals, ...]:
        """Intervals of the free parameters of a fit to these very conditions; the same from the same seed."""
        thetas = self.estimates(fit, replicates, seed)
        free, log = fit.structure.free, logarithmic(fit.structure)
        ok = np.all(np.isfinite(thetas), axis=1)
        return tuple(
            _interval(p, bool(log[i]), thetas[ok, i], level, int(np.sum(~ok))) for i, p in enumerate(free)
        )

    def estimates(self, fit: FitResult, replicates: int, seed: int) -> Array:
        """Estimates (replicates, n_free) of the free parameters, nan where one ran off."""
        rng = np.random.default_rng(seed)
        made = [group(fit.structure, replicates, rng) for group in self.groups]
        conditions = [restricted(g.condition, fit.structure) for g in self.groups]
        return refitted(fit.structure, conditions, made)


def _interval(p: Parameter, log: bool, theta: Array, level: float, failed: int) -> Intervals:
    """The basic interval 2 theta^ - quantiles, on a log scale for positive parameters."""
    if theta.size < max(2, failed):
        return Intervals(p.name, np.nan, np.nan, level, np.nan, np.nan, theta.size, failed)
    x, best = (np.log(theta), np.log(p.value)) if log else (theta, p.value)
    low, high = 2 * best - np.quantile(x, [(1 + level) / 2, (1 - level) / 2])
    ends = np.exp((low, high)) if log else np.array((low, high))
    low, high = np.clip(ends, p.lower, p.upper)
    sd, bias = float(np.std(theta, ddof=1)), float(np.mean(theta) - p.value)
    return Intervals(p.name, float(low), float(high), level, sd, bias, theta.size, failed)
