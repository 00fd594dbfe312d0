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

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from math import isfinite, nan

import numpy as np

from rover_sweep.data.geometry import FRICTION, GRAVITY
from rover_sweep.data.recording import Array, Recording
from rover_sweep.data.results import LEVEL, ByName, Quantity
from rover_sweep.identification.fit import Condition, Estimate, FitResult, restricted
from rover_sweep.identification.grouping import Group, Settings
from rover_sweep.identification.handling import (
    SCALE_ERROR,
    force_turned,
    has_handling,
    peak_lateral_acceleration,
)
from rover_sweep.identification.model_results import STIFFNESSES, ModelResult
from rover_sweep.identification.models import LAG, lagged_fit
from rover_sweep.identification.modes import mode_quantities, mode_values
from rover_sweep.identification.refit import GroupReplicator, Known, refitted_replicates
from rover_sweep.spectra.side_by_side import side_by_side

SEED = 0


class Bootstrap:
    """Replicates of the responses of these groups, shared by all models that are refitted to them.

    known: replicators of these runs from other bootstraps; reused, and new ones are added.
    """

    def __init__(
        self, groups: Sequence[Group], conditions: Sequence[Condition], known: Known | None = None
    ) -> None:
        found: Known = {} if known is None else known
        self.groups = [GroupReplicator(g, c, found) for g, c in zip(groups, conditions, strict=True)]

    def intervals(self, fit: FitResult, replicates: int = 200, seed: int = SEED) -> ByName[Estimate]:
        """The free parameters of a fit with their intervals, reproducible for a seed.

        fit must be the optimum for the conditions of this bootstrap.
        """
        return of_parameters(fit, self.estimates(fit, replicates, seed))

    def estimates(self, fit: FitResult, replicates: int, seed: int) -> Array:
        """theta_b (replicates, n_free) in parameter units; nan in rows where the refit diverged."""
        rng = np.random.default_rng(seed)
        made = [group(fit.structure, replicates, rng) for group in self.groups]
        conditions = [restricted(g.condition, fit.structure) for g in self.groups]
        return refitted_replicates(fit.structure, conditions, made)


def of_parameters(fit: FitResult, thetas: Array) -> ByName[Estimate]:
    """The free parameters with intervals from their replicates (n, n_free), nan in rows that diverged."""
    ok = np.all(np.isfinite(thetas), axis=1)
    failed, out = int(np.sum(~ok)), []
    for p, theta in zip(fit.structure.free, thetas[ok].T, strict=True):
        e, (low, high) = fit[p.name], _interval(p.value, p.lower > 0, theta, failed)
        sd = bias = nan
        if isfinite(low):
            sd, bias = float(np.std(theta, ddof=1)), float(np.mean(theta) - p.value)
        if not e.at_bound:
            e = replace(e, low=max(low, p.lower), high=min(high, p.upper), sd=sd, bias=bias)
        out.append(replace(e, replicates=theta.size, failed=failed))
    return ByName(out)


def of_modes(fit: FitResult, thetas: Array) -> tuple[Quantity, ...]:
    """The fit's modes with intervals from the same replicates; one without a mode counts as diverged."""
    names = [p.name for p in fit.structure.free]
    ok = thetas[np.all(np.isfinite(thetas), axis=1)]
    moved = [
        mode_values(fit.structure.with_values(dict(zip(names, theta, strict=True))), fit.speed)
        for theta in ok
    ]
    out = []
    for mode in mode_quantities(fit.structure, fit.speed):
        having = np.array([m[mode.name] for m in moved if mode.name in m])
        log = mode.value > 0 and bool(np.all(having > 0))
        low, high = _interval(mode.value, log, having, len(thetas) - having.size)
        out.append(replace(mode, low=low, high=high))
    return tuple(out)


def _interval(best: float, log: bool, theta: Array, failed: int) -> tuple[float, float]:
    """The basic interval of the module's text, widened to hold the estimate where the bias is larger.

    theta (n,): replicates; failed: number that diverged; nan when it is more than half.
    """
    if theta.size < max(2, failed):
        return nan, nan
    x, middle = (np.log(theta), np.log(best)) if log else (theta, best)
    low, high = 2 * middle - np.quantile(x, [(1 + LEVEL) / 2, (1 - LEVEL) / 2])
    ends = np.exp((low, high)) if log else np.array((low, high))
    return float(min(ends[0], best)), float(max(ends[1], best))


# Intervals that also hold what the model's structure leaves out.
#
# The bootstrap repeats the noise only. On a simulated rover, whose servo has a lag and whose tyres saturate,
# its intervals of Cf, Cr and tau held the truth in none of 10 repeats. So each interval is widened to hold
#
# 1. the same interval about the estimate of a refit with a lag of the steering: a servo loses gain, which a
#    pure delay does not, and the fit lowers Cf instead. Of tau, the delay and the lag together.
# 2. for all but tau, `SCALE_ERROR` of the steering's scale, the wheelbase and the speed; for tau, `TIMING`.
# 3. above the cornering stiffnesses, what the tyres lose at the amplitude of the runs, see `stiffness_loss`.
# 4. above the bicycle model's Izz, `ROLL_LEFT_OUT`: without roll, the fit has less inertia instead.
#
# The modes are widened by 1, 2 and, of the yaw mode, 3.


ROLL_LEFT_OUT = 0.35  # of Izz, above it: on simulated rovers the bicycle model's was 10 to 38 % too low
DELAY = "tau"
TIMING = 0.0025  # s, half a main loop at 200 Hz: error of the time stamps of commands and sensors


def stiffness_loss(runs: Sequence[Recording], friction: float | None = None) -> float:
    """Share by which a fit to runs of this amplitude may underestimate the zero-slip stiffness.

    Saturation: a force mu N tanh(C alpha/(mu N)) has the describing function C (1 - u^2/4) to second order,
    u = a_y/(mu g) of the largest run, at most 1. The share lost by `force_turned` is added.
    friction: mu, peak side force of the tyres over their load, 0.5 when None.
    """
    limit = (friction or FRICTION) * GRAVITY
    largest = max((peak_lateral_acceleration(run) for run in runs), default=0.0)
    return min(largest / limit, 1.0) ** 2 / 4 + force_turned(runs)


def with_structural_error(found: FitResult, conditions: Sequence[Condition], loss: float) -> FitResult:
    """A bootstrapped fit with its intervals widened by structural errors; unchanged without tyres.

    conditions: data of the fit. loss: see `stiffness_loss`. sd and bias stay those of the bootstrap.
    """
    if not has_handling(found.structure) or not any(e.interval_90 for e in found.estimates):
        return found
    lagged = lagged_fit(found, conditions)
    stuck = any(e.at_bound for e in lagged.estimates if e.name not in (LAG.name, DELAY))
    usable = not stuck and lagged.average <= found.average * (1 + 1e-3)  # not in a worse minimum
    with_lag = lagged if usable else None
    return replace(
        found,
        estimates=tuple(_widened(e, found, with_lag, loss) for e in found.estimates),
        mode_intervals=tuple(_widened_mode(i, found, with_lag, loss) for i in found.mode_intervals),
    )


def _widened(e: Estimate, found: FitResult, lagged: FitResult | None, loss: float) -> Estimate:
    if e.low is None or e.high is None or not isfinite(e.low + e.high):
        return e
    ends = [e.low, e.high, e.value]
    if lagged is not None:  # about the refit's estimate: in proportion, of a delay by the difference
        values = lagged.structure.values
        if e.name == DELAY:
            moved = values[DELAY] + values[LAG.name] - e.value
            ends += [e.low + moved, e.high + moved]
        else:
            share = values[e.name] / e.value if e.value else 1.0
            ends += [e.low * share, e.high * share]
    low, high = min(ends), max(ends)
    if e.name == DELAY:
        low, high = low - TIMING, high + TIMING
    else:
        low, high = low - SCALE_ERROR * abs(low), high + SCALE_ERROR * abs(high)
    if e.name in STIFFNESSES:
        high /= 1 - loss
    if e.name == "Izz" and found.structure.name == "bicycle":
        high *= 1 + ROLL_LEFT_OUT
    p = next(p for p in found.structure.free if p.name == e.name)
    return replace(e, low=max(low, p.lower), high=min(high, p.upper))


def _widened_mode(i: Quantity, found: FitResult, lagged: FitResult | None, loss: float) -> Quantity:
    """As the parameters': about the refit's mode too, and what tyres lose, which slows the yaw mode."""
    if i.low is None or i.high is None:
        return i
    ends = [i.low, i.high]
    if lagged is not None:
        there = mode_values(found.structure.with_values(lagged.structure.values), found.speed)
        share = there.get(i.name, i.value) / i.value
        ends += [i.low * share, i.high * share]
    low, high = min(ends), max(ends)
    low, high = low - SCALE_ERROR * abs(low), high + SCALE_ERROR * abs(high)
    if i.name == "yaw_frequency":
        high /= 1 - loss
    if i.name == "yaw_time_constant":
        low *= 1 - loss
    return replace(i, low=low, high=high)


# Bootstrap intervals of all models that were identified from the same runs.


def with_intervals(
    models: Mapping[str, ModelResult],
    groups: Sequence[Group],
    settings: Settings,
    friction: float | None = None,
) -> dict[str, ModelResult]:
    """The models with intervals of their free parameters, from `settings.bootstrap` replicates.

    Those of the bicycle and roll-yaw model include structural errors (`with_structural_error`), except as in
    the paper. friction: of the tyres, see `stiffness_loss`.

    Unchanged for 0 replicates, and where responses are conditioned on another input, because the replicates
    are driven by the steering alone. A lumped model uses the first speed only.
    """
    if not settings.bootstrap or any(g.others for g in groups):
        return dict(models)

    known: Known = {}
    loss = 0.0 if settings.as_paper else stiffness_loss([run for g in groups for run in g.runs], friction)

    @cache
    def bootstrap_of(outputs: tuple[str, ...], count: int) -> Bootstrap:
        return Bootstrap(groups[:count], [g.condition(outputs) for g in groups[:count]], known)

    def of(model: ModelResult) -> Bootstrap:
        return bootstrap_of(
            tuple(model.fit.costs), 1 if model.fit.structure.name == "lumped" else len(groups)
        )

    def bootstrapped(model: ModelResult) -> ModelResult:
        thetas = of(model).estimates(model.fit, settings.bootstrap, SEED)
        made = dict(of_parameters(model.fit, thetas).items())
        every = tuple(made.get(e.name, e) for e in model.fit.estimates)
        found = replace(model.fit, estimates=every, mode_intervals=of_modes(model.fit, thetas))
        if not settings.as_paper:
            conditions = [g.condition(tuple(found.costs)) for g in groups]
            found = with_structural_error(found, conditions, loss)
        return replace(model, fit=found)

    for model in models.values():  # before the threads, which would build the same one twice
        of(model)
    return dict(zip(models, side_by_side(bootstrapped, list(models.values())), strict=True))
