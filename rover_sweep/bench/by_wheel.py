"""An IMU on the road wheel, beside the PWM: curve, play, lag, delay and rate limit in one fit. Pure.

The model of `linkage` is driven with the PWM that was put out and compared with the wheel's angle, or with
its rate. When exactly a PWM changed is known to the interval of SERVO_OUTPUT_RAW, so each step has a shift of
its own, with that much freedom. A zero and a drift of the angle (a bias of the rate) are fitted too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from rover_sweep.bench.alignment import first_offset
from rover_sweep.bench.linkage import curve, driven
from rover_sweep.bench.numbers_of import static_numbers
from rover_sweep.bench.result import LEVEL, BenchResult, Number, interval, rate_limit
from rover_sweep.errors import DataRefused
from rover_sweep.identify.recording import Array

JUMP = 25.0  # us between two outputs, from which they are a step
LEAST_STEPS = 4
BLOCK = 0.25  # s over which what the model leaves may hang together
SCALE = 0.005  # share by which a gyro's scale and its axis, some degrees off the kingpin's, may be wrong
SLOPES = ("rad_per_us", "centre", "left", "right")
USUAL = {"e": 0.15, "c3": 6.0, "w": 0.02}  # standard deviations, as in `by_hand`
STARTS_OF_PLAY = (0.003, 0.02)  # rad


@dataclass(frozen=True)
class Wheel:
    """t (n,) s; angle (n,) rad or rate (n,) rad/s, left positive if `sign` is known.

    clock: standard deviation [s] of its clock beside the rover's, inf where they are not related.
    """

    t: Array
    value: Array
    is_rate: bool
    clock: float


@dataclass(frozen=True)
class Command:
    """What was put out: t (m,) s, pwm (m,) us; trim [us]: taken as straight ahead."""

    t: Array
    pwm: Array
    trim: float


@dataclass(frozen=True)
class _Problem:
    command: Command
    wheel: Wheel
    names: tuple[str, ...]
    due: Array
    step: Array  # (m,) number of the step that an output belongs to, -1 for none
    offset: float
    noise: float
    jitter: float

    def unpack(self, x: Array) -> dict[str, float]:
        return dict(zip(self.names, x[: len(self.names)], strict=True))

    def angle(self, x: Array) -> Array:
        q, shifts = self.unpack(x), np.append(x[len(self.names) :], 0.0)
        target = curve(-q["k"] * (self.command.pwm - self.command.trim), q["e"], q["c3"], q["w"])
        due = np.maximum.accumulate(self.due + shifts[self.step] + self.offset + q["delay"])
        return driven(due, target, self.wheel.t, q["lag"], q["slowness"], q["b"])

    def residual(self, x: Array) -> Array:
        """What is left of the wheel (n,), in standard deviations of its noise; then what the priors say."""
        q, model, t = self.unpack(x), self.angle(x), self.wheel.t
        if self.wheel.is_rate:
            left = (
                np.diff(model) / np.diff(t) + q["zero"] - 0.5 * (self.wheel.value[1:] + self.wheel.value[:-1])
            )
        else:
            left = model + q["zero"] + q["drift"] * (t - t[0]) - self.wheel.value
        usual = [q[n] / sd for n, sd in USUAL.items() if n in q]
        return np.concatenate((left / self.noise, usual, x[len(self.names) :] / self.jitter))


def by_wheel(command: Command, wheel: Wheel, sign: float | None) -> BenchResult:
    """The numbers. sign: that of rad_per_us, None where not known (then it is taken as positive).

    DataRefused for a wheel that hardly turned, or for clocks that cannot be brought together.
    """
    from scipy.optimize import least_squares
    from scipy.stats import norm

    offset, slope = first_offset(command.t, command.pwm, wheel.t, wheel.value, wheel.is_rate, wheel.clock)
    turned = slope * (sign or 1.0) > 0  # the angle grew with the PWM: it is counted to the right
    if turned:
        wheel = replace(wheel, value=-wheel.value)
    problem = _problem(command, wheel, offset)
    if problem.step.max() + 1 < LEAST_STEPS and not isfinite(wheel.clock):
        raise DataRefused(
            "without steps the wheel's clock cannot be brought to the rover's; bench with steps"
        )
    low, scale = _bounds(problem)
    best: Any = None
    for gap in STARTS_OF_PLAY:
        start = _start(problem, abs(slope) * (sign or 1.0), gap)
        done = least_squares(problem.residual, start, x_scale=scale, bounds=(low, np.inf), max_nfev=60)
        if best is None or done.cost < best.cost:
            best = done
    return _result(problem, best, float(norm.ppf(0.5 + LEVEL / 2)), sign, turned)


def _problem(command: Command, wheel: Wheel, offset: float) -> _Problem:
    if command.t.size < 20 or wheel.t.size < 100:
        raise DataRefused(
            f"{command.t.size} outputs and {wheel.t.size} samples of the wheel are too few for a bench"
        )
    between = np.diff(command.t)
    usual = float(np.median(between))
    due = np.concatenate((command.t[:1], command.t[1:] - 0.5 * between))  # it changed between the two
    jumped = np.concatenate(([False], np.abs(np.diff(command.pwm)) > JUMP))
    step = np.where(jumped, np.cumsum(jumped) - 1, -1)
    after = np.diff(wheel.value, 2) if not wheel.is_rate else np.diff(wheel.value)
    noise = 1.4826 * float(np.median(np.abs(after))) / (6.0**0.5 if not wheel.is_rate else 2.0)
    inside = (wheel.t > command.t[0] + offset) & (wheel.t < command.t[-1] + offset)
    if inside.sum() < 100:
        raise DataRefused("the wheel's record and the rover's do not overlap in time")
    cut = replace(wheel, t=wheel.t[inside], value=wheel.value[inside])
    rates = ("zero",) if wheel.is_rate else ("zero", "drift")
    names = ("k", "e", "c3", "w", "b", "lag", "slowness", "delay", *rates)
    return _Problem(command, cut, names, due, step, offset, max(noise, 1e-5), usual / 12**0.5)


def _start(problem: _Problem, k: float, gap: float) -> Array:
    zero = float(np.median(problem.wheel.value))
    start = {"k": k, "e": 0.0, "c3": 0.0, "w": 0.0, "b": gap, "lag": 0.03, "slowness": 0.05,
             "delay": 0.0, "zero": zero if problem.wheel.is_rate else -zero, "drift": 0.0}  # fmt: skip
    return np.array([start[n] for n in problem.names] + [0.0] * int(problem.step.max() + 1))


def _bounds(problem: _Problem) -> tuple[Array, Array]:
    least = {"b": 0.0, "lag": 0.0, "slowness": 0.0}
    scale = {"k": 1e-4, "e": 0.05, "c3": 1.0, "w": 0.005, "b": 0.003, "lag": 0.01, "slowness": 0.05,
             "delay": 0.01, "zero": 0.01, "drift": 1e-3}  # fmt: skip
    shifts = int(problem.step.max() + 1)
    low = [least.get(n, -np.inf) for n in problem.names] + [-np.inf] * shifts
    return np.array(low), np.array([scale[n] for n in problem.names] + [problem.jitter] * shifts)


def _covariance(problem: _Problem, done: Any) -> tuple[Array, float]:
    """Covariance of all that was fitted, and the noise in `problem.noise`s: what is left, hanging together
    over a BLOCK as it does."""
    size = problem.wheel.t.size - (1 if problem.wheel.is_rate else 0)
    left = done.fun[:size]
    noise = float(np.sqrt(left @ left / max(size - done.x.size, 1)))
    width = max(int(BLOCK / float(np.median(np.diff(problem.wheel.t)))), 2)
    blocks = left[: size // width * width].reshape(-1, width).sum(axis=1)
    together = max(1.0, float(blocks @ blocks) / (blocks.size * width * noise**2))
    jacobian = done.jac.copy()
    jacobian[:size] /= max(noise, 1.0) * together**0.5
    return np.linalg.pinv(jacobian.T @ jacobian), noise


def _result(problem: _Problem, done: Any, factor: float, sign: float | None, turned: bool) -> BenchResult:
    covariance, noise = _covariance(problem, done)
    names, x = problem.names, done.x[: len(problem.names)]
    q, sd = problem.unpack(done.x), dict(zip(names, np.sqrt(np.diag(covariance)), strict=False))
    static = [names.index(n) for n in ("k", "e", "c3", "w", "b")]
    reach = float(np.max(np.abs(problem.command.pwm - problem.command.trim)))
    numbers = [*static_numbers([names[k] for k in static], x[static],
                               covariance[np.ix_(static, static)], factor, reach)]  # fmt: skip
    numbers = [_with_scale(number, factor) if number.name in SLOPES else number for number in numbers]
    untold = ["trim_us: an IMU on the wheel does not know straight ahead; read it by hand (--hand)"]
    enough = problem.step.max() + 1 >= LEAST_STEPS
    if enough:
        numbers += _timing(problem, q, sd, factor, untold)
    else:
        untold.append(f"servo_lag, servo_delay and servo_rate_limit take {LEAST_STEPS} steps or more")
    unit = "rad/s" if problem.wheel.is_rate else "rad"
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
        "IMU on the wheel", tuple(numbers), tuple(untold), tuple(remarks),
        noise * problem.noise, int(problem.wheel.t.size),
    )  # fmt: skip


def _with_scale(number: Number, factor: float) -> Number:
    sd = float(np.hypot(number.sd, SCALE * number.value))
    return interval(number.name, number.unit, number.value, sd, factor, number.meaning, number.key)


def _timing(
    problem: _Problem, q: dict[str, float], sd: dict[str, float], factor: float, untold: list[str]
) -> Sequence[Number]:
    lag = interval(
        "servo_lag", "s", q["lag"], sd["lag"], factor, "first-order lag", "steering.servo_lag", 0.0
    )
    found = [lag, rate_limit(q["slowness"], sd["slowness"], factor)]
    if found[1].value != found[1].value:
        untold.append(
            f"servo_rate_limit: no step reached it, it is above {found[1].low:.3g} rad/s; take larger steps"
        )
    if isfinite(problem.wheel.clock):
        unseen = problem.jitter / float(problem.step.max() + 1) ** 0.5  # when the outputs changed
        deviation = float(np.sqrt(sd["delay"] ** 2 + unseen**2 + problem.wheel.clock**2))
        delay = q["delay"] + problem.offset
        meaning = "from the output to the first movement"
        found.append(interval("servo_delay", "s", delay, deviation, factor, meaning,
                              "steering.servo_delay", 0.0))  # fmt: skip
    else:
        untold.append(
            "servo_delay: the wheel's clock is its own, and a delay looks as a clock that differs does "
            "(--wheel-clock vehicle where it is the rover's)"
        )
    return found
