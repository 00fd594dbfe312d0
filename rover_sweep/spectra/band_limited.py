"""Interpolation of spectra to any frequencies from an even grid as fine as the window resolves.

The mean spectrum of windows of length T is the Fourier transform of a correlation that is zero beyond lags
of +-T. By the sampling theorem its values on an even grid finer than pi/T determine it everywhere.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array

OVERSAMPLED = 2.0  # how much finer than pi/T the grid is
REACH = 12  # grid points on each side of an interpolated value; error 1e-8 of the largest of them


def even_grid(w: Array, length: float) -> Array:
    """Even grid (n_grid,) [rad/s] for interpolating spectra of windows of `length` [s] to w (ascending)."""
    step = np.pi / (OVERSAMPLED * length)
    count = int(np.ceil((w[-1] - w[0]) / step)) + 2 * REACH + 1
    return np.asarray(w[0] + step * (np.arange(count) - REACH))


def sinc_interpolated(grid: Array, values: NDArray[Any], w: Array) -> NDArray[Any]:
    """values (..., n_grid) on an even grid, interpolated to w (n_w,): (..., n_w).

    w must be within the range that `even_grid` was made for. A sinc times the window exp(b (sqrt(1 - u^2) -
    1)) (Barnett, Magland and af Klinteberg 2019).
    """
    place = (w - grid[0]) / (grid[1] - grid[0])
    nearest = np.clip(place.astype(int), REACH - 1, grid.size - REACH - 1)
    taps = np.arange(1 - REACH, REACH + 1)
    away = (place - nearest)[:, None] - taps
    sharpness = np.pi * REACH * (1 - 1 / OVERSAMPLED)
    inside = np.sqrt(np.maximum(1 - (away / REACH) ** 2, 0.0))
    weights = np.sinc(away) * np.exp(sharpness * (inside - 1))
    return np.asarray(np.einsum("...wk,wk->...w", values[..., nearest[:, None] + taps], weights))
