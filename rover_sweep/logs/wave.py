"""What a steering signal does: where it is active, and whether it is a sweep or a doublet."""

from __future__ import annotations

import numpy as np

from rover_sweep.identify.recording import Kind, Signal
from rover_sweep.logs.log import Array

ACTIVE_US, ACTIVE_RAD = 10.0, 0.01  # departure from straight that counts as steering
MOVING_SPEED = 0.3  # m/s
PAUSE = 5.0  # s: longer without steering ends a run
SHORTEST_RUN = 4.0  # s
REVERSALS = 2  # a run steers to both sides


def active_intervals(steering: Signal, speed: Signal) -> list[tuple[float, float]]:
    """Intervals (start, end) s in which the rover moves and is steered to and fro."""
    moving = np.interp(steering.t, speed.t, speed.x, left=0.0, right=0.0) > MOVING_SPEED
    if moving.sum() < 2:
        return []
    straight = float(np.median(steering.x[moving]))
    active = moving & (np.abs(steering.x - straight) > active_threshold(steering))
    times = steering.t[active]
    if times.size == 0:
        return []
    halted = np.concatenate(([0], np.cumsum(~moving)))  # a stop between two samples separates runs
    index = np.flatnonzero(active)
    cuts = np.flatnonzero((np.diff(times) > PAUSE) | (np.diff(halted[index]) > 0)) + 1
    spans = [(float(part[0]), float(part[-1])) for part in np.split(times, cuts)]
    return [
        s
        for s in spans
        if s[1] - s[0] >= SHORTEST_RUN and _reversals(steering.between(*s), straight) >= REVERSALS
    ]


def active_threshold(steering: Signal) -> float:
    """Departure from straight, in the signal's unit, that counts as steering."""
    return ACTIVE_RAD if steering.unit == "rad" else ACTIVE_US


def _crossings(signal: Signal, level: float) -> Array:
    """Times (n,) s at which the signal crosses a level, ignoring what stays within a tenth of its amplitude."""
    x = signal.x - level
    far = np.abs(x) > 0.1 * np.max(np.abs(x), initial=0.0)
    t, sign = signal.t[far], np.sign(x[far])
    turn = np.flatnonzero(np.diff(sign) != 0)
    return (t[turn] + t[turn + 1]) / 2


def _reversals(signal: Signal, level: float) -> int:
    return int(_crossings(signal, level).size)


def kind_of(steering: Signal) -> Kind:
    """'sweep' if its half periods shrink throughout, 'doublet' if it sits on three levels, else 'other'."""
    if steering.t.size < 8 or np.ptp(steering.x) <= active_threshold(steering):
        return "other"
    if _on_three_levels(steering):
        return "doublet"
    middle = (np.min(steering.x) + np.max(steering.x)) / 2
    halves = np.diff(_crossings(steering, float(middle)))
    if halves.size < 6:
        return "other"
    third = halves.size // 3
    shrinks = np.median(halves[:third]) > 2 * np.median(halves[-third:])
    return "sweep" if shrinks and _rank_correlation(halves) < -0.6 else "other"


def _on_three_levels(steering: Signal) -> bool:
    """Whether the signal is nearly always at -A, 0 or +A from its centre, and at both extremes."""
    low, high = float(np.min(steering.x)), float(np.max(steering.x))
    t, x = steering.t, steering.x
    weight = np.append(np.diff(t), 0.0)
    near = [np.abs(x - level) < 0.08 * (high - low) / 2 for level in (low, (low + high) / 2, high)]
    shares = [float(weight[n].sum() / weight.sum()) for n in near]
    return sum(shares) > 0.85 and min(shares[0], shares[2]) > 0.1


def _rank_correlation(x: Array) -> float:
    """Spearman's correlation of a series with its index."""
    ranks = np.argsort(np.argsort(x))
    return float(np.corrcoef(ranks, np.arange(x.size))[0, 1])
