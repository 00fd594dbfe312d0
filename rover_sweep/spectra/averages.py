"""How many independent averages windows stand for, counted from where they lie.

T_F / T_win holds for records of many windows. Near the record's length it flatters: three windows of
15 s within 20 s would count as 2.7 and are worth 1.5, so the longest window of a short record would
outweigh the others in the composite and its chance coherence would pass for knowledge.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.data.recording import Array


def hann_correlation(shift: Array) -> Array:
    """Correlation of a Hann window with itself moved by `shift` of its length (Harris 1978, eq. 17)."""
    u = np.minimum(np.abs(shift), 1.0)
    return (1 - u) * (2 + np.cos(2 * np.pi * u)) / 3 + np.sin(2 * np.pi * u) / (2 * np.pi)


def independent_averages(starts: Sequence[Array], length: float) -> float:
    """Number of independent averages that the windows of `length` [s] of all runs are worth.

    starts: per run, (n_windows,) s. The variance of a mean of spectra whose windows overlap (Welch 1967):
    1 / sum_ij rho^2((t_i - t_j)/length) * n^2; tends to 1.9 T_F/T_win at 80 % overlap.
    """
    count = sum(s.size for s in starts)
    shared = sum(
        float(np.sum(hann_correlation((s[:, None] - s[None, :]) / length) ** 2)) for s in starts if s.size
    )
    return count**2 / shared if shared else 0.0
