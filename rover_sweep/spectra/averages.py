"""The number of independent averages of overlapping windows, from their positions.

T_F / T_win holds for records of many windows. Near the length of the record it is too large: three windows
of 15 s within 20 s would count as 2.7 instead of 1.5. The longest window of a short record would then get
too much weight in the composite, and its coherence by chance would count as signal.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rover_sweep.data.recording import Array


def hann_correlation(shift: Array) -> Array:
    """Correlation (...) of a Hann window with itself at `shift` (...) of its length (Harris 1978, eq. 17)."""
    u = np.minimum(np.abs(shift), 1.0)
    return (1 - u) * (2 + np.cos(2 * np.pi * u)) / 3 + np.sin(2 * np.pi * u) / (2 * np.pi)


def independent_averages(starts: Sequence[Array], length: float) -> float:
    """Number of independent averages with the variance of the mean over overlapping windows (Welch 1967).

    n^2 / sum_ij rho^2((t_i - t_j)/length) for n windows of `length` [s] at t_i, rho the correlation of the
    window; tends to 1.9 T_F/T_win at 80 % overlap. starts: per run, (n_windows,) [s].
    """
    count = sum(s.size for s in starts)
    shared = sum(
        float(np.sum(hann_correlation((s[:, None] - s[None, :]) / length) ** 2)) for s in starts if s.size
    )
    return count**2 / shared if shared else 0.0
