"""Intervals that also hold what the model's structure leaves out.

The bootstrap repeats the noise only. On a simulated rover, whose servo has a lag and whose tyres saturate,
its intervals of Cf, Cr and tau held the truth in none of 10 repeats. So each interval is widened to hold

1. the same interval about the estimate of a refit with a lag of the steering: a servo loses gain, which a
   pure delay does not, and the fit lowers Cf instead. Of tau, the delay and the lag together.
2. for all but tau, `SCALE_ERROR` of the steering's scale, the wheelbase and the speed; for tau, `TIMING`.
3. above the cornering stiffnesses, what the tyres lose at the amplitude of the runs, see `stiffness_loss`.
4. above the bicycle model's Izz, `ROLL_LEFT_OUT`: without roll, the fit has less inertia instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rover_sweep.data.geometry import FRICTION, GRAVITY
from rover_sweep.data.intervals import Intervals
from rover_sweep.data.recording import Recording
from rover_sweep.identification.cost import Condition
from rover_sweep.identification.fit import Estimate, FitResult
from rover_sweep.identification.handling import SCALE_ERROR, force_turned, has_handling
from rover_sweep.identification.handling_limits import peak_lateral_acceleration
from rover_sweep.identification.models.steering_lag import LAG, lagged_fit

STIFFNESSES = ("C", "Cf", "Cr")
ROLL_LEFT_OUT = 0.35  # of Izz, above it: on simulated rovers the bicycle model's was 10 to 38 % too low
DELAY = "tau"
TIMING = 0.0025  # s, half a main loop at 200 Hz: error of the time stamps of commands and sensors


def stiffness_loss(runs: Sequence[Recording], friction: float | None = None) -> float:
    """Share of the stiffness at zero slip that a fit to these runs may lose by their amplitude.

    Saturation: a force mu N tanh(C alpha/(mu N)) has the describing function C (1 - u^2/4) to second order,
    u = a_y/(mu g) of the largest run, 1 at most. In addition the steered force turns away, `force_turned`.
    friction: mu, peak side force of the tyres over their load, 0.5 when None.
    """
    limit = (friction or FRICTION) * GRAVITY
    largest = max((peak_lateral_acceleration(run) for run in runs), default=0.0)
    return min(largest / limit, 1.0) ** 2 / 4 + force_turned(runs)


def with_structural_error(found: FitResult, conditions: Sequence[Condition], loss: float) -> FitResult:
    """A bootstrapped fit with its intervals widened as in the module's text; unchanged without tyres.

    conditions: data of the fit. loss: see `stiffness_loss`. sd and bias stay those of the bootstrap.
    """
    if not has_handling(found.structure) or not any(e.interval for e in found.estimates):
        return found
    lagged = _usable(lagged_fit(found, conditions), found)
    return replace(found, estimates=tuple(_widened(e, found, lagged, loss) for e in found.estimates))


def _usable(lagged: FitResult, found: FitResult) -> FitResult | None:
    """The refit, None where it ended in a worse minimum or ran to a bound."""
    stuck = any(e.at_bound for e in lagged.estimates if e.name not in (LAG.name, DELAY))
    return None if stuck or not lagged.average <= found.average * (1 + 1e-3) else lagged


def _widened(e: Estimate, found: FitResult, lagged: FitResult | None, loss: float) -> Estimate:
    if e.interval is None or not np.isfinite((e.interval.low, e.interval.high)).all():
        return e
    i = e.interval
    ends = [i.low, i.high, e.value]
    if lagged is not None:
        ends += _about(e, i, lagged)
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
    return replace(e, interval=replace(i, low=max(low, p.lower), high=min(high, p.upper)))


def _about(e: Estimate, i: Intervals, lagged: FitResult) -> list[float]:
    """The interval's ends about the estimate of the refit: in proportion, of a delay by the difference."""
    values = lagged.structure.values
    if e.name == DELAY:
        moved = values[DELAY] + values[LAG.name] - e.value
        return [i.low + moved, i.high + moved]
    share = values[e.name] / e.value if e.value else 1.0
    return [i.low * share, i.high * share]
