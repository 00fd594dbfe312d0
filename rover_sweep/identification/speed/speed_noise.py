"""The noise of a measured speed: white and coloured parts, and what they do to a least-squares estimate.

The speed of an EKF on GPS wanders over seconds. Its autocovariance is taken as s^2 exp(-|lag| / time) and a
white part, from the residual's own at a fifth and two fifths of a second. A fit makes its residual look
whiter than the noise, so time and variance are corrected by the samples that are independent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rover_sweep.data.recording import Array

NEAR = 0.2  # s
LONGEST = 3.0  # s


@dataclass(frozen=True)
class SpeedNoise:
    """white, coloured: standard deviations [m/s]; time: over which the coloured part is correlated [s]."""

    white: float
    coloured: float
    time: float

    def covariance_times(self, x: Array, period: float) -> Array:
        """The covariance (n, n) [m^2/s^2] at even times, times x (n, p); without building the matrix."""
        from scipy.signal import lfilter

        share = float(np.exp(-period / self.time))
        ahead = lfilter([1.0], [1.0, -share], x, axis=0)
        back = lfilter([1.0], [1.0, -share], x[::-1], axis=0)[::-1]
        return np.asarray(self.coloured**2 * (ahead + back - x) + self.white**2 * x)


def noise_of(residuals: list[Array], period: float, parameters: int) -> SpeedNoise:
    """The noise behind the residuals (n,) [m/s] of each run of a fit of so many parameters."""
    step = max(round(NEAR / period), 1)
    seconds = sum(e.size for e in residuals) * period
    none, near, far = (
        float(np.mean(np.concatenate([e[: e.size - k] * e[k:] for e in residuals])))
        for k in (0, step, 2 * step)
    )
    if near <= 0:
        return SpeedNoise(float(np.sqrt(none)), 0.0, NEAR)
    decay = float(np.clip(far / near, 0.05, np.exp(-NEAR / LONGEST)))
    time = min(-NEAR / float(np.log(decay)), LONGEST)
    for _ in range(3):  # each estimate of the time says how many samples are independent
        independent = max(seconds / (2 * time), 2.0 * parameters)
        corrected = min(time * independent / (independent - parameters), LONGEST)
    coloured = min(near / decay, none)
    scale = independent / (independent - parameters)
    return SpeedNoise(
        float(np.sqrt(max(none - coloured, 0.0))), float(np.sqrt(coloured * scale)), float(corrected)
    )
