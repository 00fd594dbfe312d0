"""An IMU on the road wheel, beside the PWM: curve, play, lag, delay and rate limit in one fit. Pure.

The model of `linkage` is driven with the PWM that was put out and compared with the wheel's angle, or with
its rate.
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
SCALE = 0.005  # share by which a gyro's scale and its axis, some degrees off the kingpin's, may be wrong
SLOPES = ("rad_per_us", "centre", "left", "right")


def by_wheel(command: Command, wheel: Wheel, sign: float | None) -> BenchResult:
    """The numbers. sign: that of rad_per_us, None where not known (then it is taken as positive).

    DataRefused for a wheel that hardly turned, or for clocks that cannot be brought together.
    """
    from scipy.stats import norm

    offset, slope = first_offset(command.t, command.pwm, wheel.t, wheel.value, wheel.is_rate, wheel.clock)
    turned = slope * (sign or 1.0) > 0  # the angle grew with the PWM: it is counted to the right
    if turned:
        wheel = replace(wheel, value=-wheel.value)
    problem = problem_of(command, wheel, offset, abs(slope))
    if problem.step.max() + 1 < LEAST_STEPS and not isfinite(wheel.clock):
        raise DataRefused(
            "without steps the wheel's clock cannot be brought to the rover's; bench with steps"
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
    untold = ["trim_us: an IMU on the wheel does not know straight ahead; read it by hand (--hand)"]
    enough = problem.step.max() + 1 >= LEAST_STEPS
    if enough:
        numbers += _timing(problem, q, sd, factor, untold)
    else:
        untold.append(f"servo_lag, servo_delay and servo_rate_limit take {LEAST_STEPS} steps or more")
    unit = f"rad in {STRIDE:g} s" if problem.wheel.is_rate else "rad"
    remarks = [
        f"what the model leaves of the wheel: {noise * problem.noise:.2g} {unit} rms",
        f"slopes carry {SCALE:.1%} for the IMU's scale and for an axis that is not quite the kingpin's",
        "backlash holds a servo's stopping short too: standing still the two look alike",
    ]
    if sign is None:
        remarks.append(
            "rad_per_us is taken as positive (a larger PWM turns right): the vehicle file has none"
        )
    if turned:
        remarks.append("the wheel's angle is counted to the right, as by an IMU with its z axis down")
    return BenchResult(
        "IMU on the wheel",
        tuple(numbers),
        tuple(untold),
        tuple(remarks),
        noise * problem.noise,
        int(problem.wheel.t.size),
    )


def _limit(problem: WheelProblem, q: dict[str, float], sd: dict[str, float], factor: float) -> Number:
    """The rate limit; where no step came up to it, what the steps asked for is its lower end."""
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
            f"servo_rate_limit: no step reached it, it is above {found[1].low:.3g} rad/s; take larger steps"
        )
    if isfinite(problem.wheel.clock):
        unseen = problem.jitter  # of all alike: outputs and their messages may keep step
        deviation = float(np.sqrt(sd["delay"] ** 2 + unseen**2 + problem.wheel.clock**2))
        delay = q["delay"] + problem.offset
        meaning = "from SERVO_OUTPUT_RAW to the first movement, up to a main loop of it the autopilot's"
        found.append(
            interval("servo_delay", "s", delay, deviation, factor, meaning, "steering.servo_delay", 0.0)
        )
    else:
        untold.append(
            "servo_delay: the wheel's clock is its own, and a delay looks as a clock that differs does "
            "(--wheel-clock vehicle where it is the rover's)"
        )
    return found
