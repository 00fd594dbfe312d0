"""Driving in which the rover turns differently for its steering before and after some moment.

One law holds for a whole drive. Where the gain that each piece of the drive shows jumps at one moment, two
parts of the drive contradict each other: a heading that jumped, another speed scale, a linkage that slipped.
More driving does not help then, so this is told apart from too little driving.

A law with understeer can hide such a jump: where the recorded speed falls to a third at one moment and the
rover turns as before, a rover that hardly turns more for more speed looks the same. So where the recorded
speed jumps faster than any rover brakes, or the understeer is beyond any rover's, the understeer explains
nothing, and the gains of the pieces are compared without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from rover_sweep.data.recording import Array
from rover_sweep.driving.fit import BLOCK, NAMES, SETTLED, SPREAD, DrivingFit, fitted_yaw_rate
from rover_sweep.driving.stretches import RATE, DrivenPart

FEWEST = 3  # blocks on each side of the moment
LEAST_WEIGHT = 0.1  # of the turning, on each side
LEAST_CHANGE = 1.2  # ratio of the gains; surfaces, loads and the law's own errors make less (tests/driving)
CHANCE = 1e-3  # that equal parts look so different at any of the moments
INVERSE = 0.25  # of the logarithm: the speed then changed by the inverse of the gain
FOLLOWS = 0.5  # share of the yaw rate; with less, the fit says nothing on the pieces
LATE = 0.15  # s, by which turns follow the steering where no fit says it
MOST_UNDERSTEER = 3.0 * SPREAD[NAMES.index("understeer")]  # s^2/m^2: beyond it, the law contradicts its prior
JUMP, JUMP_TIME = 1.0, 0.1  # m/s within s: 10 m/s^2, faster than tyres brake
AROUND = 1.0  # s before and after a jump, in which the speed stays on each side


@dataclass(frozen=True)
class GainChange:
    """The moment at which two parts of a drive contradict each other.

    name: of the log; at: its time [s]; ratio: gain after over gain before, below 0 where the rover turns to
    the other side; speeds: median (before, after) [m/s].
    """

    name: str
    at: float
    ratio: float
    speeds: tuple[float, float]

    @property
    def of_speed(self) -> bool:
        """Whether the speed changed by the inverse, so that speed times gain stayed: the speed is wrong."""
        before, after = (abs(v) for v in self.speeds)
        if self.ratio <= 0:
            return False
        return bool(abs(np.log(self.ratio * after / before)) < INVERSE * abs(np.log(self.ratio)))

    @property
    def words(self) -> str:
        """The sentence of a report, with the moment and what to compare."""
        turns = f"turns {self.ratio:.2g} times as much" if self.ratio > 0 else "turns to the other side"
        found = (
            f"two parts of this driving contradict each other: from about {self.at:.0f} s of {self.name} on, "
            f"the rover {turns} for its steering"
        )
        before, after = self.speeds
        if self.of_speed:
            return (
                f"{found}, and the recorded speed changed by the inverse ({before:.2f} to {after:.2f} m/s): "
                "it is wrong in one part. Compare the heading with the course over ground there: it may have "
                "jumped"
            )
        return f"{found}. Compare heading, speed and steering there, and identify both parts on their own"


@dataclass(frozen=True)
class _Block:
    """gain: relative to that of the law, or in its unit without one; power: of the turning that shows it;
    speed: mean [m/s]; name of the log; at: begin [s]."""

    gain: float
    power: float
    speed: float
    name: str
    at: float


@dataclass(frozen=True)
class _Jump:
    """Of the recorded speed: log, time [s], speeds (before, after) [m/s]."""

    name: str
    at: float
    speeds: tuple[float, float]


def gain_change(fit: DrivingFit, parts: Sequence[DrivenPart]) -> GainChange | None:
    """The moment that divides the driving into two parts with different gains; None without one.

    The moment is that of the largest F (one mean against two) of the blocks' gains, with the chance of any
    moment counted; or that of a jump of the recorded speed.
    """
    long = [part for part in parts if part.t.size > 2 * SETTLED]
    jump = _speed_jump(long)
    blocks = [block for part in long for block in _blocks(fit, part, jump is not None)]
    if len(blocks) < 2 * FEWEST:
        return None
    gain, power, speed = (np.array([getattr(b, name) for b in blocks]) for name in ("gain", "power", "speed"))
    weight = power / (power + np.median(power))  # more turning than usual shows hardly more
    moments = range(FEWEST, len(blocks) - FEWEST + 1)
    if jump is not None:
        after_jump = [k for k in moments if blocks[k].name == jump.name and blocks[k].at >= jump.at]
        moments = range(after_jump[0], after_jump[0] + 1) if after_jump else range(0)
    k = _moment(gain, weight, moments)
    if k is None:
        return None
    before, after = (_usual(gain[s], weight[s]) for s in (slice(k), slice(k, None)))
    ratio = after / before
    if ratio > 0 and 1 / LEAST_CHANGE < ratio < LEAST_CHANGE:
        return None
    if jump is not None:
        return GainChange(jump.name, jump.at, ratio, jump.speeds)
    speeds = float(np.median(speed[:k])), float(np.median(speed[k:]))
    return GainChange(blocks[k].name, blocks[k].at, ratio, speeds)


def _moment(gain: Array, weight: Array, moments: Sequence[int]) -> int | None:
    """The first block after the moment of the largest F, None if chance makes one as large."""
    whole, best = _scatter(gain, weight), (0.0, 0)
    for k in moments:
        if min(weight[:k].sum(), weight[k:].sum()) < LEAST_WEIGHT * weight.sum():
            continue
        left = _scatter(gain[:k], weight[:k]) + _scatter(gain[k:], weight[k:])
        best = max(best, ((whole - left) / max(left, 1e-12 * whole, 1e-300) * (gain.size - 2), k))
    f, k = best
    rare = k > 0 and len(moments) * f_distribution.sf(f, 1, gain.size - 2) < CHANCE
    return k if rare else None


def _blocks(fit: DrivingFit, part: DrivenPart, jumps: bool) -> list[_Block]:
    """The blocks of `BLOCK` seconds of a part. jumps: the recorded speed jumps somewhere."""
    law = fit.explained >= FOLLOWS
    if law:
        model, measured = fitted_yaw_rate(fit, part) - fit["bias"], part.r - fit["bias"]
    else:
        steering = part.steered(LATE)
        model, measured = part.v * (steering - np.median(steering)), part.r - np.median(part.r)
    without = law and (jumps or abs(fit["understeer"]) > MOST_UNDERSTEER)
    rows, found = np.arange(SETTLED, part.t.size), []
    for block in np.array_split(rows, max(1, round(rows.size / (BLOCK * RATE)))):
        m, y, v = model[block], measured[block], part.v[block]
        if power := float(m @ m):
            understeer = 1 + fit["understeer"] * float(np.mean(np.square(v))) if without else 1.0
            gain = float(m @ y) / power / understeer
            found.append(_Block(gain, power, float(np.mean(v)), part.name, float(part.t[block[0]])))
    return found


def _speed_jump(parts: Sequence[DrivenPart]) -> _Jump | None:
    """The largest jump of the recorded speed that lasts, None without one."""
    found: list[_Jump] = []
    wide, brief = round(AROUND * RATE), round(JUMP_TIME * RATE)
    for part in parts:
        at = np.flatnonzero(np.abs(part.v[brief:] - part.v[:-brief]) > JUMP)
        for i in at[np.diff(at, prepend=-2 * wide) > 1]:  # the first of each jump
            before, after = part.v[max(i - wide, 0) : i + 1], part.v[i + 2 * brief : i + 2 * brief + wide]
            if after.size == wide and i > wide:
                speeds = float(np.median(before)), float(np.median(after))
                found.append(_Jump(part.name, float(part.t[i]), speeds))
    largest = max(found, key=lambda jump: abs(np.subtract(*jump.speeds)), default=None)
    return largest if largest and abs(np.subtract(*largest.speeds)) > JUMP else None


def _usual(gain: Array, weight: Array) -> float:
    """Median gain of the half of the blocks with the most turning."""
    return float(np.median(gain[weight >= np.median(weight)]))


def _scatter(gain: Array, weight: Array) -> float:
    """Weighted sum of squares about the weighted mean."""
    return float(weight @ np.square(gain - np.average(gain, weights=weight)))
