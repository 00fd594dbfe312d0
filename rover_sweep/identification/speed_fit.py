"""Fit of the speed's law to sweeps by simulation, with 90 % intervals that allow for coloured noise.

Least squares of the simulated against the measured speed (output error: unbiased for noise of any colour in
the measurement). The covariance is that of least squares with correlated noise (`speed_noise.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array, ThrottleRun
from rover_sweep.data.results import NORMAL_90

# The law of the speed: a first-order lag behind a dead time and an offset of the throttle.
#
#     T v' = K (u(t - tau) - u0) - v        while the motor drives, u > 0
#
# u is the throttle as a share of full, v the speed [m/s]. K/T is the acceleration per throttle, v/T the drag
# that grows with the speed (the motor's back-EMF, mostly), K u0 / T what must be overcome before the rover
# moves: the dead zone of the motor controller and the rolling resistance. A sweep alone cannot tell these
# two apart; coasting can (`coasting.py`).


@dataclass(frozen=True)
class SpeedModel:
    """gain [m/s per full throttle], lag [s], delay [s], offset: throttle (share of full) at which the steady
    speed extrapolates to zero."""

    gain: float
    lag: float
    delay: float
    offset: float

    def steady(self, throttle: float) -> float:
        """Steady speed [m/s] at a throttle (share of full)."""
        return self.gain * (throttle - self.offset)

    def throttle(self, speed: float) -> float:
        """Throttle (share of full) that holds a speed [m/s]."""
        return self.offset + speed / self.gain

    def response(self, w: Array) -> NDArray[np.complex128]:
        """Frequency response (n,) [m/s per full throttle] at w (n,) rad/s."""
        return np.asarray(self.gain * np.exp(-1j * w * self.delay) / (1 + 1j * w * self.lag))


def simulated(model: SpeedModel, felt: Array, start: float, period: float) -> Array:
    """Speed (n,) [m/s] for a throttle (n,) that already includes the delay, from `start` [m/s]; exact for a
    throttle that is constant within a period [s]."""
    from scipy.signal import lfilter

    a = math.exp(-period / model.lag)
    pulled = model.gain * (felt - model.offset)
    return np.asarray(lfilter([0.0, 1.0 - a], [1.0, -a], pulled, zi=[start])[0])


# The noise of a measured speed: white and coloured parts, and what they do to a least-squares estimate.
#
# The speed of an EKF on GPS wanders over seconds. Its autocovariance is taken as s^2 exp(-|lag| / time) and
# a white part, from the residual's own at a fifth and two fifths of a second. A fit makes its residual look
# whiter than the noise, so time and variance are corrected by the samples that are independent.


NEAR = 0.2  # s
LONGEST = 3.0  # s


@dataclass(frozen=True)
class SpeedNoise:
    """white, coloured: standard deviations [m/s]; time: over which the coloured part is correlated [s]."""

    white: float
    coloured: float
    time: float

    def covariance_times(self, x: Array, period: float) -> Array:
        """The covariance (n, n) [m^2/s^2] at even times, times x (n, p); without building the matrix."""
        from scipy.signal import lfilter

        share = float(np.exp(-period / self.time))
        ahead = lfilter([1.0], [1.0, -share], x, axis=0)
        back = lfilter([1.0], [1.0, -share], x[::-1], axis=0)[::-1]
        return np.asarray(self.coloured**2 * (ahead + back - x) + self.white**2 * x)


def noise_of(residuals: list[Array], period: float, parameters: int) -> SpeedNoise:
    """Noise estimated from each run's residuals (n,) [m/s]; parameters: number fitted."""
    step = max(round(NEAR / period), 1)
    seconds = sum(e.size for e in residuals) * period
    none, near, far = (
        float(np.mean(np.concatenate([e[: e.size - k] * e[k:] for e in residuals])))
        for k in (0, step, 2 * step)
    )
    if near <= 0:
        return SpeedNoise(float(np.sqrt(none)), 0.0, NEAR)
    decay = float(np.clip(far / near, 0.05, np.exp(-NEAR / LONGEST)))
    time = min(-NEAR / float(np.log(decay)), LONGEST)
    for _ in range(3):  # each estimate of the time says how many samples are independent
        independent = max(seconds / (2 * time), 2.0 * parameters)
        corrected = min(time * independent / (independent - parameters), LONGEST)
    coloured = min(near / decay, none)
    scale = independent / (independent - parameters)
    return SpeedNoise(
        float(np.sqrt(max(none - coloured, 0.0))), float(np.sqrt(coloured * scale)), float(corrected)
    )


PERIOD = 0.04  # s, grid of the fit: some 20 points per period of the fastest sweep
MOST_DELAY = 1.0  # s
NAMES = ("gain", "lag", "delay", "offset")


@dataclass(frozen=True, eq=False)
class SpeedFit:
    """model; intervals: 90 % {name: (low, high)}; covariance (4, 4) of gain, lag, delay, offset. fit: share
    of the speed's variation that is explained, 1 is all; residual [m/s rms]; noise: its model; at_bound:
    names at a bound; starts: speed of each run as its override begins [m/s]."""

    model: SpeedModel
    intervals: dict[str, tuple[float, float]]
    covariance: Array
    fit: float
    residual: float
    noise: SpeedNoise
    at_bound: tuple[str, ...] = ()
    starts: tuple[float, ...] = ()


def grid_of(run: ThrottleRun, period: float = PERIOD) -> Array:
    """Evenly spaced times (n,) [s] of the override."""
    start, end = run.span
    return np.arange(start, end, period)


def fit_speed(runs: Sequence[ThrottleRun]) -> SpeedFit:
    """Fits one law to all runs; each has its own initial speed."""
    from scipy.optimize import least_squares

    grids = [grid_of(run) for run in runs]
    seen = [run.speed.on(t) for run, t in zip(runs, grids, strict=True)]

    def residuals(x: Array) -> Array:
        model = _model(x)
        parts = [
            simulated(model, run.drive(t + PERIOD / 2 - model.delay), v0, PERIOD) - v
            for run, t, v, v0 in zip(runs, grids, seen, x[4:], strict=True)
        ]
        return np.concatenate(parts)

    start = np.concatenate((_first_guess(runs, grids, seen), [v[0] for v in seen]))
    low = np.concatenate(([-3.0, -4.0, 0.0, -1.0], np.full(len(runs), -1.0)))
    high = np.concatenate(([5.0, 3.0, MOST_DELAY, 1.0], np.full(len(runs), 60.0)))
    start = np.clip(start, low + 1e-6, high - 1e-6)
    found = least_squares(residuals, start, bounds=(low, high), x_scale=np.where(start == 0, 0.1, 0.1))
    ends_of_runs = np.cumsum([t.size for t in grids])[:-1]
    noise = noise_of(np.split(found.fun, ends_of_runs), PERIOD, len(NAMES))
    covariance = _covariance(found.jac, noise, grids)[:4, :4]
    spread = NORMAL_90 * np.sqrt(np.diag(covariance))
    bound = [
        n for n, x, lo, hi in zip(NAMES, found.x, low, high, strict=False) if x - lo < 1e-4 or hi - x < 1e-4
    ]
    ends = [(_value(k, found.x[k] - spread[k]), _value(k, found.x[k] + spread[k])) for k in range(4)]
    varied = np.concatenate([v - v.mean() for v in seen])
    return SpeedFit(
        _model(found.x),
        dict(zip(NAMES, ends, strict=True)),
        covariance,
        1.0 - float(np.sum(found.fun**2) / np.sum(varied**2)),
        float(np.sqrt(np.mean(found.fun**2))),
        noise,
        tuple(bound),
        tuple(float(v) for v in found.x[4:]),
    )


def fitted_speed(found: SpeedFit, run: ThrottleRun, start: float) -> tuple[Array, Array]:
    """Times (n,) [s] of a run's override and the law's speed (n,) [m/s], from the fitted `start` [m/s]."""
    t = grid_of(run)
    return t, simulated(found.model, run.drive(t + PERIOD / 2 - found.model.delay), start, PERIOD)


def _model(x: Array) -> SpeedModel:
    return SpeedModel(float(np.exp(x[0])), float(np.exp(x[1])), float(x[2]), float(x[3]))


def _value(k: int, x: float) -> float:
    return float(np.exp(x)) if k < 2 else max(float(x), 0.0) if k == 2 else float(x)


def _first_guess(runs: Sequence[ThrottleRun], grids: Sequence[Array], seen: Sequence[Array]) -> Array:
    """log gain, log lag, delay, offset from the best of a few lags: linear in gain and offset."""
    best, least = np.array([1.0, 0.0, 0.1, 0.0]), np.inf
    for lag in (0.2, 0.5, 1.0, 2.0, 4.0):
        rows, values = [], []
        for run, t, v in zip(runs, grids, seen, strict=True):
            u = run.drive(t + PERIOD / 2 - 0.1)
            unit = SpeedModel(1.0, lag, 0.1, 0.0)
            rows.append(np.column_stack((simulated(unit, u, u[0], PERIOD), np.ones(t.size))))
            values.append(v)
        a, b = np.concatenate(rows), np.concatenate(values)
        (gain, rest), *_ = np.linalg.lstsq(a, b, rcond=None)
        error = float(np.sum((a @ np.array([gain, rest]) - b) ** 2))
        if gain > 0 and error < least:
            best, least = np.array([np.log(gain), np.log(lag), 0.1, -rest / gain]), error
    return best


def _covariance(jacobian: Array, noise: SpeedNoise, grids: Sequence[Array]) -> Array:
    """Covariance (p, p) of a least-squares fit whose residuals are correlated within each run."""
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    middle, k = np.zeros_like(inverse), 0
    for t in grids:
        part = jacobian[k : k + t.size]
        middle = middle + part.T @ noise.covariance_times(part, PERIOD)
        k += t.size
    return np.asarray(inverse @ middle @ inverse)
