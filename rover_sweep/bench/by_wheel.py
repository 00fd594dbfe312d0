"""Fits curve, play, lag, delay and rate limit to the PWM and an IMU on the road wheel. Pure.

The model of `linkage` gets the recorded PWM; its angle, or rate, is compared with the wheel's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from typing import Any

import numpy as np

from rover_sweep.bench.alignment import first_offset
from rover_sweep.bench.bench_result import LEVEL, BenchResult, Number, interval, rate_limit
from rover_sweep.bench.static_curve import static_numbers
from rover_sweep.bench.wheel_fit import covariance_of, fitted
from rover_sweep.bench.wheel_problem import STRIDE, Command, Wheel, WheelProblem, problem_of
from rover_sweep.errors import DataRefused

LEAST_STEPS = 4
SCALE = 0.005  # relative error from a gyro's scale and from its axis, some degrees off the kingpin's
SLOPES = ("rad_per_us", "centre", "left", "right")


def by_wheel(command: Command, wheel: Wheel, sign: float | None) -> BenchResult:
    """Fit the numbers. sign: of rad_per_us, None if unknown (then taken as positive).

    DataRefused for a wheel that hardly turned, or for clocks that cannot be aligned.
    """
    from scipy.stats import norm

    offset, slope = first_offset(command.t, command.pwm, wheel.t, wheel.value, wheel.is_rate, wheel.clock)
    turned = slope * (sign or 1.0) > 0  # the angle grows with the PWM: it is positive to the right
    if turned:
        wheel = replace(wheel, value=-wheel.value)
    problem = problem_of(command, wheel, offset, abs(slope))
    if problem.step.max() + 1 < LEAST_STEPS and not isfinite(wheel.clock):
        raise DataRefused(
            "the wheel's clock cannot be aligned with the rover's without steps; bench with steps"
        )
    best = fitted(problem, abs(slope) * (sign or 1.0))
    return _result(problem, best, float(norm.ppf(0.5 + LEVEL / 2)), sign, turned)


def _result(problem: WheelProblem, done: Any, factor: float, sign: float | None, turned: bool) -> BenchResult:
    covariance, noise = covariance_of(problem, done)
    names, x = problem.names, done.x[: len(problem.names)]
    q, sd = (
        problem.unpack(done.x),
        dict(zip(names, np.sqrt(np.maximum(np.diag(covariance), 0.0)), strict=False)),
    )
    static = [names.index(n) for n in ("k", "e", "c3", "w", "b")]
    reach = float(np.max(np.abs(problem.command.pwm - problem.command.trim)))
    numbers = [
        *static_numbers(
            [names[k] for k in static], x[static], covariance[np.ix_(static, static)], factor, reach
        )
    ]
    numbers = [_with_scale(number, factor) if number.name in SLOPES else number for number in numbers]
    untold = ["trim_us: an IMU on the wheel cannot measure straight ahead; read it by hand (--hand)"]
    enough = problem.step.max() + 1 >= LEAST_STEPS
    if enough:
        numbers += _timing(problem, q, sd, factor, untold)
    else:
        untold.append(f"servo_lag, servo_delay and servo_rate_limit need at least {LEAST_STEPS} steps")
    unit = f"rad in {STRIDE:g} s" if problem.wheel.is_rate else "rad"
    remarks = [
        f"residual of the wheel's angle: {noise * problem.noise:.2g} {unit} rms",
        f"the intervals of rad per us allow for an error of {SCALE:.1%} from the IMU's scale and its angle "
        "to the kingpin axis",
        "backlash includes the error with which the servo stops short: at rest the two cannot be separated",
    ]
    if sign is None:
        remarks.append(
            "rad_per_us is taken as positive (a larger PWM turns right): the vehicle file has none"
        )
    if turned:
        remarks.append("the wheel's angle is positive to the right, as from an IMU with its z axis down")
    return BenchResult(
        "IMU on the wheel",
        tuple(numbers),
        tuple(untold),
        tuple(remarks),
        noise * problem.noise,
        int(problem.wheel.t.size),
    )


def _limit(problem: WheelProblem, q: dict[str, float], sd: dict[str, float], factor: float) -> Number:
    """The rate limit; if no step reached it, the rate that the steps asked for is its lower bound."""
    largest = float(np.max(np.abs(np.diff(problem.command.pwm)))) * abs(q["k"])
    asked = largest / max(q["lag"] + factor * sd["lag"], 1e-3)
    least, most = (q["slowness"] + side * factor * sd["slowness"] for side in (-1, 1))
    if sd["slowness"] > 0 and least * asked > 1.0:
        return rate_limit(q["slowness"], float(np.hypot(sd["slowness"], SCALE * q["slowness"])), factor)
    return rate_limit(0.0, max(most, 1.0 / asked) / factor, factor)


def _with_scale(number: Number, factor: float) -> Number:
    sd = float(np.hypot(number.sd, SCALE * number.value))
    return interval(number.name, number.unit, number.value, sd, factor, number.meaning, number.key)


def _timing(
    problem: WheelProblem, q: dict[str, float], sd: dict[str, float], factor: float, untold: list[str]
) -> Sequence[Number]:
    lag = interval(
        "servo_lag", "s", q["lag"], sd["lag"], factor, "first-order lag", "steering.servo_lag", 0.0
    )
    found = [lag, _limit(problem, q, sd, factor)]
    if not found[1].determined:
        untold.append(
            f"servo_rate_limit: no step reached it, it is above {found[1].low:.3g} rad/s; use larger steps"
        )
    if isfinite(problem.wheel.clock):
        unseen = problem.jitter  # common to all steps: outputs and their messages may be in step
        deviation = float(np.sqrt(sd["delay"] ** 2 + unseen**2 + problem.wheel.clock**2))
        delay = q["delay"] + problem.offset
        meaning = "from SERVO_OUTPUT_RAW to the first movement; up to a main loop of it is the autopilot's"
        found.append(
            interval("servo_delay", "s", delay, deviation, factor, meaning, "steering.servo_delay", 0.0)
        )
    else:
        untold.append(
            "servo_delay: the wheel has its own clock, and a delay cannot be separated from a clock offset "
            "(--wheel-clock vehicle if it uses the rover's clock)"
        )
    return found
