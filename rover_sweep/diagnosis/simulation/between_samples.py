"""Values between the samples of a log, by cubics: straight lines take 5 % of 10 Hz from samples at 100 Hz."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array, Signal

EVEN = 2.0  # times the usual interval of samples, up to which a cubic is put through them


def on_grid(channel: Signal, grid: Array) -> Array:
    """Values (n,) of a channel at the times of an even `grid` (n,) [s].

    A cubic through the four nearest samples, a straight line beside gaps. A staircase is averaged over the
    cells of the grid, and what the average takes from high frequencies is given back: u - u'' step^2 / 24.
    """
    rough = channel.on(grid)
    if channel.hold:
        return rough - np.diff(np.pad(rough, 1, "edge"), 2) / 24.0
    t, x = channel.t, channel.x
    if t.size < 4:
        return rough
    k = np.clip(np.searchsorted(t, grid, "right") - 1, 1, t.size - 3)
    near = [t[k + j] for j in (-1, 0, 1, 2)]
    widest = np.max([b - a for a, b in zip(near, near[1:], strict=False)], axis=0)
    narrow = np.min([b - a for a, b in zip(near, near[1:], strict=False)], axis=0)
    usual = float(np.median(np.diff(t)))
    cubic = np.zeros(grid.size)
    with np.errstate(divide="ignore", invalid="ignore"):
        for j, own in enumerate(near):
            others = [other for i, other in enumerate(near) if i != j]
            weight = np.prod([(grid - o) / (own - o) for o in others], axis=0)
            cubic += weight * x[k + j - 1]
    inside = (grid >= t[0]) & (grid <= t[-1])
    smooth = inside & (widest <= EVEN * usual) & (narrow >= usual / EVEN / 2.0)
    return np.where(smooth, cubic, rough)
