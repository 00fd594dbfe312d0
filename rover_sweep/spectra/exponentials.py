"""Fourier sums of stretches of samples at given frequencies, on any time stamps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array

Complex = NDArray[np.complex128]


def _exponentials(t: Array, w: Array) -> Complex:
    angle = np.outer(t, w)
    return np.asarray(np.cos(angle) - 1j * np.sin(angle))


class Exponentials:
    """exp(-j w t) of all stamps t (n,) s and frequencies w (n_w,) rad/s."""

    def __init__(self, t: Array, w: Array) -> None:
        self._kernel = _exponentials(t, w)

    def sum(self, first: int, last: int, weights: Array) -> Complex:
        """sum_k weights[k] exp(-j w t_k) (n_w,) over the stamps first <= k < last."""
        total: Complex = weights @ self._kernel[first:last]
        return total


class EvenExponentials:
    """The same for evenly spaced frequencies, in rows of exp(-j t (coarse step)) times exp(-j t (fine step)).

    Splitting w = w_0 + (a B + b) dw makes of n_w exponentials a stamp only 2 sqrt(n_w), and of the sums a
    matrix product; they remain the direct sums, to rounding.
    """

    def __init__(self, t: Array, w: Array) -> None:
        self._size = w.size
        columns = int(np.ceil(np.sqrt(w.size)))
        self._coarse = _exponentials(t, w[::columns])
        self._fine = _exponentials(t, w[:columns] - w[0])

    def sum(self, first: int, last: int, weights: Array) -> Complex:
        """sum_k weights[k] exp(-j w t_k) (n_w,) over the stamps first <= k < last."""
        rows = (self._coarse[first:last] * weights[:, None]).T @ self._fine[first:last]
        return np.asarray(rows.ravel()[: self._size])
