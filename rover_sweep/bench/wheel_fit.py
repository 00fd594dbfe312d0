"""The fit of a bench with an IMU on the wheel, and its covariance. Pure."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rover_sweep.bench.wheel_problem import STRIDE, USUAL, WheelProblem
from rover_sweep.data.recording import Array

BLOCK = 0.25  # s over which the residuals may be correlated
# Play [rad] and slowness [s/rad]. A limit that no step reaches has no gradient: start where it acts.
STARTS = ((0.003, 0.5), (0.02, 0.15))


def fitted(problem: WheelProblem, k: float) -> Any:
    """The best of the starts. A rate is fitted as an angle first: its sharp edges catch a poor start."""
    from scipy.optimize import least_squares

    if problem.wheel.is_rate:
        first = _as_angle(problem)
        begun = fitted(first, k).x
        q, shifts = first.unpack(begun), begun[len(first.names) :]
        q["zero"] = q["drift"]  # of the angle, which is the bias of the rate
        slow = {**q, "slowness": max(slowness for _, slowness in STARTS)}
        starts = [np.array([*(values[name] for name in problem.names), *shifts]) for values in (q, slow)]
    else:
        starts = [_start(problem, k, gap, slowness) for gap, slowness in STARTS]
    low, scale = _bounds(problem)
    tried = [
        least_squares(problem.residual, start, x_scale=scale, bounds=(low, np.inf), max_nfev=60)
        for start in starts
    ]
    return min(tried, key=lambda done: float(done.cost))


def _as_angle(problem: WheelProblem) -> WheelProblem:
    """The same problem with the integrated angle, whose noise grows as a random walk."""
    t = problem.wheel.t
    growth = problem.noise * ((t[-1] - t[0]) / STRIDE) ** 0.5
    wheel = replace(problem.wheel, is_rate=False)
    return replace(
        problem, wheel=wheel, names=(*problem.names, "drift"), noise=growth, spread=np.full(t.size, growth)
    )


def _start(problem: WheelProblem, k: float, gap: float, slowness: float) -> Array:
    zero = 0.0 if problem.wheel.is_rate else -float(np.median(problem.wheel.value))
    start = {
        "k": k,
        "e": 0.0,
        "c3": 0.0,
        "w": 0.0,
        "b": gap,
        "lag": 0.03,
        "slowness": slowness,
        "delay": 0.0,
        "begin": 0.0,
        "zero": zero,
        "drift": 0.0,
    }
    return np.array([start[n] for n in problem.names] + [0.0] * int(problem.step.max() + 1))


def _bounds(problem: WheelProblem) -> tuple[Array, Array]:
    least = {"b": 0.0, "lag": 0.0, "slowness": 0.0}
    scale = {
        "k": 1e-4,
        "e": 0.05,
        "c3": 1.0,
        "w": 0.005,
        "b": 0.003,
        "lag": 0.01,
        "slowness": 0.05,
        "delay": 0.01,
        "begin": 0.003,
        "zero": 0.01,
        "drift": 1e-3,
    }
    shifts = int(problem.step.max() + 1)
    low = [least.get(n, -np.inf) for n in problem.names] + [-np.inf] * shifts
    return np.array(low), np.array([scale[n] for n in problem.names] + [problem.jitter] * shifts)


def covariance_of(problem: WheelProblem, done: Any) -> tuple[Array, float]:
    """Covariance of all that was fitted, and the noise in `problem.noise`s: what is left, hanging together
    over a BLOCK as it does."""
    size = done.fun.size - len(USUAL) - 1 - (done.x.size - len(problem.names))
    left = done.fun[:size]
    noise = float(np.sqrt(left @ left / max(size - done.x.size, 1)))
    apart = float(np.median(np.diff(problem.wheel.t))) * problem.stride
    width = max(int(BLOCK / apart), 2)
    blocks = left[: size // width * width].reshape(-1, width).sum(axis=1)
    together = max(1.0, float(blocks @ blocks) / (blocks.size * width * noise**2))
    jacobian = done.jac.copy()
    jacobian[:size] /= max(noise, 1.0) * together**0.5
    return np.linalg.pinv(jacobian.T @ jacobian), noise
