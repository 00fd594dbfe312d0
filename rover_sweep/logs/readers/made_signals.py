"""Signals that are made of several recorded ones: heading of a quaternion, slopes of positions and angles."""

from __future__ import annotations

import numpy as np

from rover_sweep.logs.log import Array

NEIGHBOURS, AROUND = 2, 0.03  # samples, and s, on each side in the regression that gives a slope
HELD = 0.15  # s; a value that repeats for less is one sample that was written several times


def heading_of(x: Array, y: Array, z: Array, w: Array) -> Array:
    """The heading (n,) rad, left positive with z up, of quaternions with w last."""
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))


def slope(t: Array, x: Array) -> Array:
    """dx/dt (n,) at times t (n,) s, by regression over the nearest samples; without delay.

    Values that a slower source wrote several times count once, at their first time.
    """
    if t.size < 2:
        return np.zeros_like(x)
    new = np.concatenate(([True], np.diff(x) != 0))
    last = np.maximum.accumulate(np.where(new, t, -np.inf))
    new |= t - last >= HELD
    s, y = t[new], x[new]
    if s.size < 2:
        return np.zeros_like(x)
    reach = max(NEIGHBOURS, round(AROUND / float(np.median(np.diff(s)))))
    reach = min(reach, (s.size - 1) // 2)
    if reach == 0:
        return np.full(t.size, (y[-1] - y[0]) / (s[-1] - s[0]))
    windows = [np.lib.stride_tricks.sliding_window_view(each, 2 * reach + 1) for each in (s, y)]
    centred = [w - w.mean(axis=1, keepdims=True) for w in windows]
    middle = np.sum(centred[0] * centred[1], axis=1) / np.sum(centred[0] ** 2, axis=1)
    return np.interp(t, s[reach : s.size - reach], middle)
