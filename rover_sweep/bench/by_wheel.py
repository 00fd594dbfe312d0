"""Fits curve, play, lag, delay and rate limit to the PWM and an IMU on the road wheel. Pure.

The model of `linkage` gets the recorded PWM; its angle, or rate, is compared with the wheel's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.bench.bench_folder import BenchResult, Number, interval, rate_limit
from rover_sweep.bench.static_curve import curve, driven, first_offset, static_numbers
from rover_sweep.data.recording import Array
from rover_sweep.data.results import LEVEL
from rover_sweep.errors import DataRefused, UsageError

# A bench with an IMU on the wheel as a least-squares problem: recorded PWM and measured wheel. Pure.
#
# The time of a PWM's change is known to the interval of SERVO_OUTPUT_RAW, so each step has its own time
# shift with that uncertainty. A zero and a drift of the angle (a bias of the rate) are fitted too.


JUMP = 25.0  # us between two outputs, from which they are a step
STRIDE = 0.1  # s over which a rate is integrated
NEAR = 10  # outputs around a small step that belong to a ramp
USUAL = {"e": 0.15, "c3": 6.0, "w": 0.02}  # standard deviations, as in `by_hand`
BEGIN = 0.02  # rad, likewise, of the wheel in its gap before it is moved


@dataclass(frozen=True)
class Wheel:
    """t (n,) s; angle (n,) rad or rate (n,) rad/s, left positive if `sign` is known.

    clock: standard deviation [s] of its clock from the rover's, inf if they are unrelated.
    """

    t: Array
    value: Array
    is_rate: bool
    clock: float


@dataclass(frozen=True)
class Command:
    """The outputs: t (m,) s, pwm (m,) us; trim [us]: taken as straight ahead."""

    t: Array
    pwm: Array
    trim: float


@dataclass(frozen=True)
class WheelProblem:
    """names: what is fitted, before the shifts of the steps. due (m,) s: when an output changed, at the best
    guess; offset [s]: taken off the wheel's clock. noise [rad]; jitter [s]: standard deviation of a shift;
    stride: samples over which a rate is summed up."""

    command: Command
    wheel: Wheel
    names: tuple[str, ...]
    due: Array
    step: Array  # (m,) number of the step that an output belongs to, -1 for none
    offset: float
    noise: float
    spread: Array  # (n,) rad: standard deviation of each sample
    jitter: float
    stride: int = 1

    def unpack(self, x: Array) -> dict[str, float]:
        return dict(zip(self.names, x[: len(self.names)], strict=True))

    def angle(self, x: Array) -> Array:
        q, shifts = self.unpack(x), np.append(x[len(self.names) :], 0.0)
        target = curve(-q["k"] * (self.command.pwm - self.command.trim), q["e"], q["c3"], q["w"])
        due = np.maximum.accumulate(self.due + shifts[self.step] + q["delay"])
        return driven(due, target, self.wheel.t, q["lag"], q["slowness"], q["b"], q["begin"])

    def residual(self, x: Array) -> Array:
        """Residuals of the wheel, in standard deviations of its noise; then those of the priors.

        A rate is compared by the growth of its integral over every STRIDE, so that the noise is independent
        and edges sharper than the gyro's bandwidth do not count.
        """
        q, model, t = self.unpack(x), self.angle(x), self.wheel.t
        if self.wheel.is_rate:
            k = self.stride
            left = np.diff(model[::k]) + q["zero"] * np.diff(t[::k]) - np.diff(self.wheel.value[::k])
            left /= self.spread[::k][1:]
        else:
            left = model + q["zero"] + q["drift"] * (t - t[0]) - self.wheel.value
            left /= self.spread
        usual = [q[n] / sd for n, sd in {**USUAL, "begin": BEGIN}.items()]
        return np.concatenate((left, usual, x[len(self.names) :] / self.jitter))


def problem_of(command: Command, wheel: Wheel, offset: float, slope: float) -> WheelProblem:
    """offset [s]: lead of the wheel's clock; slope [rad/us]: approximate. DataRefused for too few data."""
    if command.t.size < 20 or wheel.t.size < 100:
        raise DataRefused(
            f"{command.t.size} outputs and {wheel.t.size} samples of the wheel are too few for a bench"
        )
    between = np.diff(command.t)
    usual = float(np.median(between))
    due = np.concatenate((command.t[:1], command.t[1:] - 0.5 * between))  # it changed between the two
    jumped = np.concatenate(([False], np.abs(np.diff(command.pwm)) > JUMP))
    step = np.where(jumped, np.cumsum(jumped) - 1, -1)
    wheel = replace(wheel, t=wheel.t - offset)  # near the rover's clock, where floats are fine enough
    inside = (wheel.t > command.t[0]) & (wheel.t < command.t[-1])
    if inside.sum() < 100:
        raise DataRefused("the wheel's record and the rover's do not overlap in time")
    cut = replace(wheel, t=wheel.t[inside], value=wheel.value[inside])
    if cut.is_rate:
        cut = replace(cut, value=_summed(cut))
    stride = max(1, round(STRIDE / float(np.median(np.diff(cut.t))))) if cut.is_rate else 1
    names: tuple[str, ...] = ("k", "e", "c3", "w", "b", "lag", "slowness", "delay", "begin", "zero")
    names = names if cut.is_rate else (*names, "drift")
    noise = max(_noise(cut, stride), 1e-5)
    spread = np.hypot(noise, slope * _ramp_steps(command, cut.t))
    return WheelProblem(command, cut, names, due, step, offset, noise, spread, usual / 12**0.5, stride)


def _summed(wheel: Wheel) -> Array:
    """The integral of a rate (n,) rad, without its median, which is mostly a bias."""
    rate = wheel.value - np.median(wheel.value)
    return np.concatenate(([0.0], np.cumsum(np.diff(wheel.t) * 0.5 * (rate[1:] + rate[:-1]))))


def _noise(wheel: Wheel, stride: int) -> float:
    """Standard deviation [rad] of an angle, or of an integrated rate's growth, from neighbouring samples."""
    if wheel.is_rate:
        return 1.4826 * float(np.median(np.abs(np.diff(wheel.value[::stride], 2)))) / 2.0**0.5
    return 1.4826 * float(np.median(np.abs(np.diff(wheel.value, 2)))) / 6.0**0.5


def _ramp_steps(command: Command, t: Array) -> Array:
    """Standard deviation [us] of a ramp's output at t (n,) s: it climbs in small steps, each at an unknown
    time between two recorded outputs."""
    change = np.abs(np.diff(command.pwm))
    climbing = (change > 0) & (change <= JUMP)
    size = float(np.median(change[climbing])) if climbing.any() else 0.0
    near = np.convolve(climbing, np.ones(2 * NEAR + 1), "same") > 0
    return size / 12**0.5 * np.interp(t, command.t[1:], near.astype(float))


# Reads a wheel's IMU: a CSV file with time and angle or rate, or telemetry of a vehicle on the wheel.


_SECONDS = {
    "t": 1.0,
    "time": 1.0,
    "t_s": 1.0,
    "time_s": 1.0,
    "timestamp": 1.0,
    "seconds": 1.0,
    "time_ms": 1e-3,
    "timestamp_ms": 1e-3,
    "time_boot_ms": 1e-3,
    "time_us": 1e-6,
    "timeus": 1e-6,
    "time_usec": 1e-6,
    "timestamp_us": 1e-6,
    "timestamp_ns": 1e-9,
}
_DEGREE = float(np.pi / 180)
_ANGLES = {
    "angle": 1.0,
    "yaw": 1.0,
    "angle_rad": 1.0,
    "yaw_rad": 1.0,
    "angle_deg": _DEGREE,
    "yaw_deg": _DEGREE,
}
_RATES = {
    "rate": 1.0,
    "yaw_rate": 1.0,
    "yawrate": 1.0,
    "yawspeed": 1.0,
    "gyro_z": 1.0,
    "gz": 1.0,
    "gyrz": 1.0,
    "rate_rad_s": 1.0,
    "yaw_rate_rad_s": 1.0,
    "rate_deg_s": _DEGREE,
    "yaw_rate_deg_s": _DEGREE,
    "gyro_z_deg_s": _DEGREE,
}
ARRIVAL = 0.02  # s, uncertainty of two clocks aligned by the arrival of their messages


def read_wheel(path: Path, same_clock: bool) -> Wheel:
    """A CSV with a header of one time column and one of the angle or the rate. UsageError, DataRefused."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise UsageError(f"there is no file {path}; give the wheel's record with --wheel-imu FILE") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DataRefused(f"{path} cannot be read: {error}") from error
    names = [name.strip().strip('"').lower() for name in lines[0].split(",")] if lines else []
    time = next((k for k, name in enumerate(names) if name in _SECONDS), None)
    angle = next((k for k, name in enumerate(names) if name in _ANGLES), None)
    rate = next((k for k, name in enumerate(names) if name in _RATES), None)
    column = angle if angle is not None else rate
    if time is None or column is None:
        raise DataRefused(
            f"{path} needs a header with a time (t, time_ms, time_us) and the wheel's angle (angle, "
            f"angle_deg, yaw) or rate (rate, rate_deg_s, gyro_z); it has {', '.join(names) or 'nothing'}"
        )
    rows = [row.split(",") for row in lines[1:] if row.strip()]
    if rows and len(rows[-1]) < len(names):  # cut off while it was written
        rows.pop()
    try:
        t = np.array([float(row[time]) for row in rows]) * _SECONDS[names[time]]
        value = np.array([float(row[column]) for row in rows])
    except (ValueError, IndexError) as error:
        raise DataRefused(f"{path}: a row is damaged ({error})") from error
    value *= _ANGLES[names[column]] if angle is not None else _RATES[names[column]]
    return _checked(path, t, value, angle is None, 0.0 if same_clock else inf)


def wheel_of_telemetry(path: Path, arrival_less_clock: float) -> Wheel:
    """ATTITUDE.yaw of a vehicle on the wheel. arrival_less_clock: our clock minus the rover's [s].

    The yaw of ArduPilot's EKF comes from the gyro before its low-pass filter, yawspeed from behind it.
    """
    from rover_sweep.logs.readers.tlog import open_tlog

    frames = open_tlog(path, frozenset({"ATTITUDE"})).messages.get("ATTITUDE")
    if frames is None:
        raise DataRefused(f"{path} has no ATTITUDE of the vehicle on the wheel")
    own = frames.rows["time_boot_ms"].astype(float) * 1e-3
    ahead = float(np.min(arrivals(path, frames.order) - own))
    yaw = np.unwrap(frames.rows["yaw"].astype(float))
    return _checked(path, own + ahead - arrival_less_clock, yaw, False, ARRIVAL)


def arrivals(path: Path, order: np.ndarray) -> Array:
    """When the frames that begin at these bytes of a .tlog came in, (n,) s of our clock."""
    data = path.read_bytes()
    return np.array([int.from_bytes(data[k - 8 : k], "big") for k in order.tolist()]) * 1e-6


def _checked(path: Path, t: Array, value: Array, is_rate: bool, clock: float) -> Wheel:
    keep = np.isfinite(t) & np.isfinite(value)
    t, value = t[keep], value[keep]
    keep = np.concatenate(([True], t[1:] > np.maximum.accumulate(t)[:-1])) if t.size else keep[:0]
    t, value = t[keep], value[keep]
    if t.size < 100:
        raise DataRefused(f"{path} has only {t.size} samples of the wheel in order of time")
    if float(np.median(np.diff(t))) > 0.05:
        raise DataRefused(
            f"{path} has a sample every {np.median(np.diff(t)):.2g} s; a servo needs one every 0.02 s (50 Hz)"
        )
    if not is_rate:
        value = np.unwrap(value)
    return Wheel(t, value, is_rate, clock)


# The fit of a bench with an IMU on the wheel, and its covariance. Pure.


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
    """Covariance of all fitted numbers, which allows for residuals that correlate within a BLOCK; and the
    noise in units of `problem.noise`."""
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
    """The rate limit; if no step reached it, its lower bound: the rate that the steps required."""
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
