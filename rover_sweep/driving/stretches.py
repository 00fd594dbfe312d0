"""The parts of a log in which driving shows how the rover steers, on an even grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from rover_sweep.data.recording import Array, LowPass, Mask, Signal, stretches
from rover_sweep.logs.find import still_intervals
from rover_sweep.logs.log import Contradiction, Log, limits_of_steering

RATE = 50.0  # Hz of the grid: ten times the fastest steering that a rover answers
SLOWEST = 0.3  # m/s; below it, the noise of the speed is a large share of the speed
STANDSTILL_SD = 0.002  # rad/s, of the bias known from standstill
SHORTEST = 4.0  # s of driving without an interruption
HOLE = 0.5  # s between samples of one channel; the driving is cut there
FASTEST_TURN = 6.0  # m/s^2 of V r: beyond it, tyres slide; up to it, the bend of the law follows them
LONGEST_SAME = 1.0  # s, of one value of a yaw rate that works
LEAST_TURN, SPINNING = 1.0, 0.75  # m/s^2 of V r, and share of it in a_y, below which the wheels spin
FULL = "of full steering"  # unit of a steering in -1 to 1, which is no angle
STAIRCASE_HZ = 30.0  # a slower record of the steering is samples of something finer and is interpolated


@dataclass(frozen=True, eq=False)
class DrivenPart:
    """Uninterrupted driving: t (n,) s on the grid, speed v (n,) m/s (negative in reverse), yaw rate r (n,)
    rad/s, left positive. steering: the recorded output in its unit, on its own time stamps. low_pass: of
    the recorded yaw rate, None where none is known.
    """

    name: str
    t: Array
    v: Array
    r: Array
    steering: Signal
    low_pass: LowPass | None

    def steered(self, delay: float) -> Array:
        """The steering (n,) `delay` seconds before each time of the grid, in its unit."""
        return self.steering.on(self.t - delay)

    @property
    def seconds(self) -> float:
        """Its length, s."""
        return float(self.t[-1] - self.t[0])


@dataclass(frozen=True, eq=False)
class Driving:
    """All usable driving of some logs. bias: of the yaw rate at standstill, rad/s, None without any.

    unit: of the steering, "us", "rad" or `FULL`. left_out: {reason: seconds}. limits: (lowest, highest)
    steering output, None where unknown. trim: the configured neutral [us], None where unknown. course: True
    where the yaw rate is that of the course over ground. contradictions: between channels of the logs.
    """

    stretches: tuple[DrivenPart, ...]
    unit: str
    bias: float | None
    left_out: dict[str, float]
    limits: tuple[float, float] | None
    trim: float | None
    course: bool = False
    contradictions: tuple[Contradiction, ...] = ()

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
    low_pass = log.filters.get("r")
    found = [
        DrivenPart(log.name, t[a : b + 1], v[a : b + 1], r[a : b + 1], steering, low_pass) for a, b in parts
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


def _near(mask: Mask, seconds: float) -> Mask:
    """The mask widened by some seconds on both sides."""
    if not mask.any():
        return mask
    reach = round(seconds * RATE)
    return np.convolve(mask, np.ones(2 * reach + 1), "same") > 0.5
