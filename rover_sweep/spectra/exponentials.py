"""Fourier sums of samples at given frequencies, on any time stamps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array

Complex = NDArray[np.complex128]


def _exponentials(t: Array, w: Array) -> Complex:
    angle = np.outer(t, w)
    kernel = np.empty(angle.shape, complex)
    np.cos(angle, out=kernel.real)
    np.negative(np.sin(angle, out=angle), out=kernel.imag)
    return kernel


class Exponentials:
    """exp(-j w t) for time stamps t (n,) [s] and frequencies w (n_w,) [rad/s]."""

    def __init__(self, t: Array, w: Array) -> None:
        self._kernel = _exponentials(t, w)

    def sum(self, first: int, last: int, weights: Array) -> Complex:
        """sum_k weights[k] exp(-j w t_k) (n_w,) over the time stamps first <= k < last."""
        total: Complex = weights @ self._kernel[first:last]
        return total


class EvenExponentials:
    """The same for evenly spaced frequencies w = w_0 + (a B + b) dw, faster.

    exp(-j w t) is the product of a coarse (a) and a fine (b) exponential, so each time stamp needs 2
    sqrt(n_w) exponentials instead of n_w, and the sums are a matrix product. Equal to the direct sums up to
    rounding.
    """

    def __init__(self, t: Array, w: Array) -> None:
        self._size = w.size
        columns = int(np.ceil(np.sqrt(w.size)))
        self._coarse = _exponentials(t, w[::columns])
        self._fine = _exponentials(t, w[:columns] - w[0])

    def sum(self, first: int, last: int, weights: Array) -> Complex:
        """sum_k weights[k] exp(-j w t_k) (n_w,) over the time stamps first <= k < last."""
        rows = (self._coarse[first:last] * weights[:, None]).T @ self._fine[first:last]
        return np.asarray(rows.ravel()[: self._size])
