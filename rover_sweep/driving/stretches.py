"""The parts of a log in which driving shows how the rover steers, on an even grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d

from rover_sweep.data.recording import ASSUMED, Array, LowPass, Mask, Signal, stretches
from rover_sweep.logs.find import still_intervals
from rover_sweep.logs.log import GYRO_FACTORY_HZ, Contradiction, Log, limits_of_steering

RATE = 50.0  # Hz of the grid: ten times the fastest steering that a rover answers
SLOWEST = 0.3  # m/s; below it, the noise of the speed is a large share of the speed
STANDSTILL_SD = 0.002  # rad/s, of the bias known from standstill
SHORTEST = 4.0  # s of driving without an interruption
HOLE = 0.5  # s between samples of one channel; the driving is cut there
FASTEST_TURN = 6.0  # m/s^2 of V r: beyond it, tyres slide; up to it, the bend of the law follows them
LONGEST_SAME = 1.0  # s, of one value of a yaw rate that works
LEAST_TURN, SPINNING = 1.0, 0.75  # m/s^2 of V r, and share of it in a_y, below which the wheels spin
FULL = "of full steering"  # unit of a steering in -1 to 1, which is no angle
OTHER_GYRO_HZ = 20.0  # slowest usual low-pass: of ArduPilot beside Rover; PX4's IMU_GYRO_CUTOFF is 30 to 40
SAME_RATE = 0.9  # of the grid's; a slower yaw rate is compared at its own samples
STEP = 0.1  # share of a step that moves in the intervals beside it
MOSTLY = 0.5  # of the motion in steps, as of a programmed manoeuvre: all may have one phase of the record
STAIRCASE_HZ = 30.0  # a slower record of the steering is samples of something finer and is interpolated


@dataclass(frozen=True, eq=False)
class DrivenPart:
    """Uninterrupted driving: t (n,) s on the grid, speed v (n,) m/s (negative in reverse), yaw rate r (n,)
    rad/s, left positive. steering: the recorded output in its unit, on its own time stamps. low_pass: of
    the recorded yaw rate, None where none is known. between: seconds between samples of a steering of which
    the motion between them is not known, else 0. samples: those of a yaw rate that was recorded slower than
    the grid, None of a faster one.
    """

    name: str
    t: Array
    v: Array
    r: Array
    steering: Signal
    low_pass: LowPass | None
    between: float = 0.0
    samples: Signal | None = None

    def steered(self, delay: float, smooth: float = 0.0) -> Array:
        """The steering (n,) `delay` seconds before each time of the grid, in its unit.

        smooth: share of the smoothest way between samples (a cubic spline); the rest goes straight.
        """
        straight = self.steering.on(self.t - delay)
        if not self.between or self.in_steps or not smooth:
            return straight
        return straight + smooth * (self._spline(self.t - delay) - straight)

    @property
    def in_steps(self) -> bool:
        """Whether the steering is steps, each at an unknown time between two samples."""
        return bool(self.between) and self.steering.hold

    @cached_property
    def measured(self) -> Array:
        """The yaw rate (m,) rad/s as it was sampled, no more often than the grid; see `at_samples`."""
        return self.r if self.samples is None else self._within.x

    def at_samples(self, x: Array) -> Array:
        """Values (m,) at the samples of the yaw rate, of values (n,) on the grid."""
        return x if self.samples is None else np.interp(self._within.t, self.t, x)

    @property
    def low_pass_unknown(self) -> bool:
        """Whether the low-pass is between the slowest usual one, of half its cut-off, and none."""
        return self.low_pass is not None and self.low_pass.source == ASSUMED

    def behind_an_end(self, slowest: bool) -> DrivenPart:
        """With the slowest low-pass, or none, in place of one that is not known."""
        if self.low_pass is None or not self.low_pass_unknown:
            return self
        slow = replace(self.low_pass, cutoff_hz=0.5 * self.low_pass.cutoff_hz)
        return replace(self, low_pass=slow if slowest else None)

    @property
    def rate(self) -> float:
        """Samples of the yaw rate a second, no more than the grid's, Hz."""
        return RATE if self.samples is None else self.samples.rate

    @cached_property
    def _within(self) -> Signal:
        assert self.samples is not None
        return self.samples.between(float(self.t[0]), float(self.t[-1]))

    @cached_property
    def _spline(self) -> CubicSpline:
        return CubicSpline(self.steering.t, self.steering.x)

    @property
    def seconds(self) -> float:
        """Its length, s."""
        return float(self.t[-1] - self.t[0])


@dataclass(frozen=True, eq=False)
class Driving:
    """All usable driving of some logs. bias: of the yaw rate at standstill, rad/s, None without any.

    unit: of the steering, "us", "rad" or `FULL`. left_out: {reason: seconds}. limits: (lowest, highest)
    steering output, None where unknown. trim: the configured neutral [us], None where unknown. coarse: the
    steering where it was logged too seldom to show its way between samples. course: True where the yaw rate
    is that of the course over ground. contradictions: between channels of the logs.
    """

    stretches: tuple[DrivenPart, ...]
    unit: str
    bias: float | None
    left_out: dict[str, float]
    limits: tuple[float, float] | None
    trim: float | None
    coarse: Signal | None = None
    course: bool = False
    contradictions: tuple[Contradiction, ...] = ()

    @property
    def low_pass_unknown(self) -> bool:
        """Whether the low-pass of a gyro is not known."""
        return any(s.low_pass_unknown for s in self.stretches)

    @property
    def speed_sd(self) -> float:
        """sd of the logarithm of the speed's scale, where it was corrected or is in doubt."""
        return max((one.speed_sd for one in self.contradictions), default=0.0)

    @property
    def known(self) -> dict[str, tuple[float, float]]:
        """The gyro's bias with its standard deviation, where the rover stood."""
        return {} if self.bias is None else {"bias": (self.bias, STANDSTILL_SD)}

    @property
    def seconds(self) -> float:
        """Length of all stretches together, s."""
        return sum(s.seconds for s in self.stretches)


def usable_driving(logs: Sequence[Log]) -> Driving:
    """Cuts logs that have steering, speed and yaw rate into stretches of driving."""
    found: list[DrivenPart] = []
    left_out: dict[str, float] = {}
    biases: list[Array] = []
    for log in logs:
        parts, out, still = _of_log(log)
        found += parts
        biases.append(still)
        left_out = {
            reason: left_out.get(reason, 0.0) + out.get(reason, 0.0) for reason in {**left_out, **out}
        }
    still = np.concatenate(biases) if biases else np.empty(0)
    first = logs[0]
    return Driving(
        tuple(found),
        FULL if "delta" in first.unsure else first.steering[0].unit,
        float(np.mean(still)) if still.size > RATE else None,
        left_out,
        first.limits,
        next((v for n, v in limits_of_steering(first.parameters).items() if n.endswith("_TRIM")), None),
        next((part.steering for part in found if part.between), None),
        any("course" in log.unsure for log in logs),
        tuple(dict.fromkeys(one for log in logs for one in log.contradictions)),
    )


def _of_log(log: Log) -> tuple[list[DrivenPart], dict[str, float], Array]:
    """Its stretches, the seconds left out for each reason, and the yaw rate at standstill."""
    loop = 1 / log.parameters.get("SCHED_LOOP_RATE", np.inf)
    steering, speed, yaw = _continuous(log.steering[0], loop), log.signals["speed"], log.signals["r"]
    first, last = (pick(f(s.t[i] for s in (steering, speed, yaw))) for pick, f, i in _ENDS)
    t = np.arange(first, last, 1 / RATE)
    v, r = speed.on(t), yaw.on(t)
    whole = np.ones(t.size, bool)
    for signal in (steering, speed, yaw):
        whole &= ~_in_holes(signal, t)
    still, sliding = np.abs(v) < SLOWEST, np.abs(v * r) > FASTEST_TURN
    dead = _dead(yaw, t, steering.on(t))
    spinning = _spinning(log, t, v, r)
    usable = whole & ~still & ~_near(sliding | spinning, 0.5) & ~dead
    parts = [(a, b) for a, b in stretches(usable) if (b - a) / RATE >= SHORTEST]
    used = np.zeros(t.size, bool)
    for a, b in parts:
        used[a : b + 1] = True
    reasons = {
        f"slower than {SLOWEST:g} m/s": still & whole,
        "holes in the record": ~whole,
        f"turns beyond {FASTEST_TURN:g} m/s²": sliding & whole & ~still,
        "the wheels spin, as the speed is far above a_y/r": spinning & whole & ~still & ~sliding,
        "the yaw rate stayed at one value": dead & whole & ~still,
    }
    reasons[f"pieces shorter than {SHORTEST:g} s"] = ~used & ~np.any(list(reasons.values()), axis=0)
    low_pass = log.filters.get("r") or _not_recorded(log)
    if low_pass is not None and low_pass.source == ASSUMED:
        # its delay is the middle of those of the slowest and none
        low_pass = replace(low_pass, cutoff_hz=2 * low_pass.cutoff_hz)
    between = 1 / steering.rate if steering.rate < STAIRCASE_HZ else 0.0
    steering = _in_steps(steering) if between and _share_of_steps(steering) > MOSTLY else steering
    samples = yaw if yaw.rate < SAME_RATE * RATE else None
    found = [
        DrivenPart(log.name, t[a : b + 1], v[a : b + 1], r[a : b + 1], steering, low_pass, between, samples)
        for a, b in parts
    ]
    standing = [yaw.between(a, b).x for a, b in still_intervals(log)]
    seconds = {reason: float(mask.sum() / RATE) for reason, mask in reasons.items()}
    return found, seconds, np.concatenate(standing) if standing else np.empty(0)


_ENDS = ((float, max, 0), (float, min, -1))


def _continuous(steering: Signal, loop: float) -> Signal:
    """Outputs logged too seldom for a staircase, as samples to interpolate between.

    Each is held for a main loop [s]: the samples are those of its middle.
    """
    if steering.rate >= STAIRCASE_HZ:
        return steering
    return replace(steering, t=steering.t + 0.5 * loop, hold=False)


def _share_of_steps(steering: Signal) -> float:
    """Share of the squared motion that takes place within one interval, with none beside it."""
    moved = np.abs(np.diff(steering.x))
    if moved.size < 3 or not moved.any():
        return 0.0
    beside = np.maximum(moved[:-2], moved[2:])
    alone = np.square(moved[1:-1][beside < STEP * moved[1:-1]])
    return float(alone.sum() / np.square(moved).sum())


def _in_steps(steering: Signal) -> Signal:
    """Samples as a steering that steps once from each to the next, in the middle between."""
    edges = np.concatenate((steering.t[:1], 0.5 * (steering.t[1:] + steering.t[:-1])))
    return replace(steering, t=edges, hold=True)


def _in_holes(signal: Signal, t: Array) -> Mask:
    """Times (n,) between two samples of the signal that are further apart than `HOLE`."""
    k = np.clip(np.searchsorted(signal.t, t, "right"), 1, signal.t.size - 1)
    return signal.t[k] - signal.t[k - 1] > HOLE


def _dead(yaw: Signal, t: Array, steering: Array) -> Mask:
    """Times (n,) in which the yaw rate has one value for `LONGEST_SAME` or more though the steering moves."""
    found: Mask = np.zeros(t.size, bool)
    moves = 0.5 * float(np.std(steering))
    for a, b in stretches(np.diff(yaw.x) == 0):
        inside = (t >= yaw.t[a]) & (t <= yaw.t[b + 1])
        if yaw.t[b + 1] - yaw.t[a] >= LONGEST_SAME and inside.any() and np.ptp(steering[inside]) > moves:
            found |= inside
    return found


def _spinning(log: Log, t: Array, v: Array, r: Array) -> Mask:
    """Times (n,) in which a_y/r is far below the speed, against what it usually is in this log."""
    none: Mask = np.zeros(t.size, bool)
    if "ay" not in log.signals or t.size < 2 * RATE:
        return none
    ay, vr = (uniform_filter1d(x, round(0.5 * RATE)) for x in (log.signals["ay"].on(t), v * r))
    turns = np.abs(vr) > LEAST_TURN
    if turns.sum() < 4 * RATE or turns.all():
        return none
    ay = ay - np.median(ay[~turns])
    usual = float(np.median(ay[turns] / vr[turns]))  # body roll adds to it
    error = np.abs(ay - usual * vr)
    clear = error > 6 * np.median(error[turns])
    known = 0.5 < usual < 1.5  # else it is another a_y
    return turns & clear & (ay * np.sign(vr) < SPINNING * usual * np.abs(vr)) if known else none


def _not_recorded(log: Log) -> LowPass | None:
    """The slowest usual low-pass of another system's gyro, which its file does not tell."""
    if log.parameters or log.vehicle or "course" in log.unsure:
        return None
    return LowPass(GYRO_FACTORY_HZ if log.steering[0].unit == "us" else OTHER_GYRO_HZ, ASSUMED)


def _near(mask: Mask, seconds: float) -> Mask:
    """The mask widened by some seconds on both sides."""
    if not mask.any():
        return mask
    reach = round(seconds * RATE)
    return np.convolve(mask, np.ones(2 * reach + 1), "same") > 0.5
