"""Angles read by hand at a staircase of PWM: the static curve and the play. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rover_sweep.bench.bench_result import LEVEL, BenchResult
from rover_sweep.bench.linkage import curve, wheel_behind_gap
from rover_sweep.bench.static_curve import static_numbers
from rover_sweep.data.recording import Array
from rover_sweep.errors import DataRefused

LEAST_READINGS = 5
LEVELS_FOR_CURVE = 3  # levels on each side that a deadband and a curvature need
# Standard deviations (priors) wider than any steering has. Without them a few noisy angles at small steps
# would bend the curve more than any linkage does.
USUAL = {"e": 0.15, "c3": 6.0, "w": 0.02}
HAND = 0.009  # rad, first guess of the noise of one angle, for the weight of the priors
NOT_BY_HAND = "servo_lag, servo_delay and servo_rate_limit cannot be read by hand: they need --wheel-imu"


@dataclass(frozen=True)
class Readings:
    """In the order in which they were taken: pwm (n,) us, angle (n,) rad left positive, NaN where none was
    read there. start: PWM [us] at which the steering began."""

    pwm: Array
    angle: Array
    start: float


def by_hand(readings: Readings, trim: float) -> BenchResult:
    """Fit the numbers; trim: SERVOn_TRIM [us], the starting value. DataRefused for too few readings."""
    from scipy.optimize import least_squares
    from scipy.stats import t as student

    read = np.isfinite(readings.angle)
    pwm, angle = readings.pwm, readings.angle
    left, right = _levels(trim - pwm[read]), _levels(pwm[read] - trim)
    names = ["k", "trim", "b", *(["e"] if left and right else [])]
    if min(left, right) >= LEVELS_FOR_CURVE:
        names += ["c3", "w"]
    if read.sum() < max(LEAST_READINGS, len(names) + 1) or np.ptp(pwm[read]) < 1:
        raise DataRefused(
            f"{read.sum()} angles were read, at {left} levels to the left and {right} to the right; at least "
            f"{max(LEAST_READINGS, len(names) + 1)} are needed, on both sides"
        )
    slope = float(np.polyfit(pwm[read] - trim, angle[read], 1)[0])
    scale = {"k": abs(slope), "trim": 10.0, "b": 0.01, "e": 0.05, "c3": 1.0, "w": 0.01}
    start = {"k": -slope, "trim": trim, "b": 0.005, "e": 0.0, "c3": 0.0, "w": 0.0}
    path = np.concatenate(([readings.start], pwm))

    def model(x: Array) -> Array:
        q = {**dict.fromkeys(scale, 0.0), **dict(zip(names, x, strict=True))}
        servo = curve(-q["k"] * (path - q["trim"]), q["e"], q["c3"], q["w"])
        return wheel_behind_gap(servo, max(q["b"], 0.0))[1:]

    low = np.array([0.0 if n == "b" else -np.inf for n in names])
    prior = np.array([1.0 / USUAL[n] if n in USUAL else 0.0 for n in names])
    free, noise = int(read.sum()) - len(names), HAND
    for _ in range(2):  # the second time with the noise that these readings have
        weight = noise * prior
        done = least_squares(
            lambda x, weight=weight: np.concatenate(((model(x) - angle)[read], weight * x)),
            [start[n] for n in names],
            x_scale=[scale[n] for n in names],
            bounds=(low, np.inf),
            diff_step=1e-4,
        )
        misfit = done.fun[: int(read.sum())]
        noise = float(np.sqrt(misfit @ misfit / free))
    covariance = noise**2 * np.linalg.pinv(done.jac.T @ done.jac)
    factor = float(student.ppf(0.5 + LEVEL / 2, free))
    reach = float(np.min([np.max(pwm[read]) - trim, trim - np.min(pwm[read])])) if left and right else 0.0
    numbers = static_numbers(names, done.x, covariance, factor, max(reach, float(np.ptp(pwm[read])) / 2))
    untold = [NOT_BY_HAND]
    if "w" not in names:
        untold.append(
            f"deadband and nonlinearity need {LEVELS_FOR_CURVE} sizes of steps, read on both sides; for "
            "example --steps 50,100,150"
        )
    if "e" not in names:
        untold.append("asymmetry needs angles on both sides")
    remarks = (
        f"reading error of an angle: {np.degrees(noise):.2g} deg (scatter about the curve)",
        "backlash includes the error with which the servo stops short: at rest the two cannot be separated",
    )
    return BenchResult("by hand", numbers, tuple(untold), remarks, noise, int(read.sum()))


def _levels(offset: Array) -> int:
    """Number of different levels above 0; offset (n,) us."""
    return len({round(x / 5.0) for x in offset.tolist() if x > 5.0})
