"""A bench with an IMU on the wheel as a least-squares problem: recorded PWM and measured wheel. Pure.

The time of a PWM's change is known to the interval of SERVO_OUTPUT_RAW, so each step has its own time shift
with that uncertainty. A zero and a drift of the angle (a bias of the rate) are fitted too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.bench.linkage import curve, driven
from rover_sweep.data.recording import Array
from rover_sweep.errors import DataRefused

JUMP = 25.0  # us between two outputs, from which they are a step
STRIDE = 0.1  # s over which a rate is integrated
NEAR = 10  # outputs around a small step that belong to a ramp
USUAL = {"e": 0.15, "c3": 6.0, "w": 0.02}  # standard deviations, as in `by_hand`
BEGIN = 0.02  # rad, likewise, of the wheel in its gap before it is moved


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
    """offset [s]: that the wheel's clock is ahead; slope [rad/us]: roughly. DataRefused for too little."""
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
