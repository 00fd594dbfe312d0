"""Detects a clipped sensor: the signal stays at one extreme value below the full scale of its channel."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rover_sweep.data.recording import Array, Note, Recording, Signal

CLIPPED = "clipped"
SENSORS = {"r": "gyro", "p": "gyro", "ay": "accelerometer"}
SHARE = 0.002  # of the run's samples at the extreme value
MIN_STAYS = 3  # separate stays of two samples or more at the extreme value
PILED_UP = 10.0  # samples at the extreme value over those at a value close to it; a sine has 3 to 8
NEAR = 0.05  # of the signal's range: values close to the extreme
STEEP = 3.0  # resolution steps in the last sample before a stay; a smooth maximum is reached in single steps
STEERED = (
    0.03  # of the steering's range: smallest change during a stay, as constant steering gives constant r
)
MIN_VALUES = 50  # distinct values of a signal; with fewer it is not judged


def clipping(run: Recording) -> Iterator[Note]:
    """A fault for each of r, p and a_y that stays at one extreme value while the steering moves."""
    steering = run.manoeuvre("delta" if "delta" in run else "pwm")
    for channel, sensor in SENSORS.items():
        if channel not in run:
            continue
        signal = run.manoeuvre(channel)
        share, extreme = max(
            (_clipped(signal, side, steering), side * _top(signal, side)) for side in (1, -1)
        )
        if share > SHARE:
            yield _fault(channel, sensor, extreme, share, signal.unit)


def _fault(channel: str, sensor: str, extreme: float, share: float, unit: str) -> Note:
    again = "drive again with a smaller amplitude, or set a larger range of the sensor"
    text = (
        f"{channel} is clipped: it stays at {extreme:.4g} {unit} for {100 * share:.1f} % of the run while "
        f"the steering moves, so the {sensor} reached its range; {again}"
    )
    return Note("warning", text, CLIPPED, (channel,))


def _top(signal: Signal, side: int) -> float:
    return float(np.max(side * signal.x, initial=-np.inf))


def _clipped(signal: Signal, side: int, steering: Signal) -> float:
    """Share of the samples at the largest (side 1) or smallest value (-1) if clipped there, else 0."""
    x = side * signal.x
    levels = np.unique(x)
    if levels.size < MIN_VALUES:
        return 0.0
    top, at = levels[-1], x == levels[-1]
    near = levels[(levels < top) & (levels > top - NEAR * (top - levels[0]))]
    usual = np.sum((x < top) & (x > top - NEAR * (top - levels[0]))) / max(near.size, 1)
    stays = _stays(at)
    if len(stays) < MIN_STAYS or at.sum() < PILED_UP * max(usual, 1.0):
        return 0.0
    if not _steep(x, stays, float(np.min(np.diff(levels)))) or not _moved(signal.t, stays, steering):
        return 0.0
    return float(np.mean(at))


def _stays(at: Array) -> list[tuple[int, int]]:
    """(first, last) indices of each stay of two samples or more."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], at.astype(np.int8), [0]))))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2) if b - a > 1]


def _steep(x: Array, stays: list[tuple[int, int]], resolution: float) -> bool:
    """True when the signal reaches its extreme value in large steps, unlike a smooth maximum."""
    steps = [x[a - 1] - x[a - 2] for a, _ in stays if a > 1]
    return bool(steps) and float(np.median(steps)) > STEEP * resolution


def _moved(t: Array, stays: list[tuple[int, int]], steering: Signal) -> bool:
    """True when the steering changes during one of the stays."""
    whole = float(np.ptp(steering.x)) if steering.x.size else 0.0
    moved = [float(np.ptp(part)) for a, b in stays if (part := steering.between(t[a], t[b]).x).size]
    return whole > 0 and max(moved, default=0.0) > STEERED * whole
