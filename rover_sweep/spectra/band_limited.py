"""Spectra at any number of frequencies from as many as a window tells apart.

The mean spectrum of windows of length T is the transform of a correlation that ends at lags of +-T. Such
a function is known everywhere from its values on an even grid finer than pi/T.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array

OVERSAMPLED = 2.0  # how much finer than pi/T the grid is
REACH = 12  # grid points on each side that a value between is made of: 1e-8 of the largest among them


def even_grid(w: Array, length: float) -> Array:
    """Even grid [rad/s] from which spectra of windows of `length` [s] follow at all of w (ascending)."""
    step = np.pi / (OVERSAMPLED * length)
    count = int(np.ceil((w[-1] - w[0]) / step)) + 2 * REACH + 1
    return np.asarray(w[0] + step * (np.arange(count) - REACH))


def between(grid: Array, values: NDArray[Any], w: Array) -> NDArray[Any]:
    """values (..., n_grid) on an even grid at w (n_w,): (..., n_w), w within `even_grid`'s reach.

    A sinc under the window exp(b (sqrt(1 - u^2) - 1)) (Barnett, Magland and af Klinteberg 2019).
    """
    place = (w - grid[0]) / (grid[1] - grid[0])
    nearest = np.clip(place.astype(int), REACH - 1, grid.size - REACH - 1)
    taps = np.arange(1 - REACH, REACH + 1)
    away = (place - nearest)[:, None] - taps
    sharpness = np.pi * REACH * (1 - 1 / OVERSAMPLED)
    inside = np.sqrt(np.maximum(1 - (away / REACH) ** 2, 0.0))
    weights = np.sinc(away) * np.exp(sharpness * (inside - 1))
    return np.asarray(np.einsum("...wk,wk->...w", values[..., nearest[:, None] + taps], weights))
