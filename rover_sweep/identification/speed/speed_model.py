"""The law of the speed: a first-order lag behind a dead time and an offset of the throttle.

    T v' = K (u(t - tau) - u0) - v        while the motor drives, u > 0

u is the throttle as a share of full, v the speed [m/s]. K/T is the acceleration per throttle, v/T the drag
that grows with the speed (the motor's back-EMF, mostly), K u0 / T what must be overcome before the rover
moves: the dead zone of the motor controller and the rolling resistance. A sweep alone cannot tell these two
apart; coasting can (`coasting.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array


@dataclass(frozen=True)
class SpeedModel:
    """gain [m/s per full throttle], lag [s], delay [s], offset: throttle (share of full) at which the steady
    speed extrapolates to zero."""

    gain: float
    lag: float
    delay: float
    offset: float

    def steady(self, throttle: float) -> float:
        """Steady speed [m/s] at a throttle (share of full)."""
        return self.gain * (throttle - self.offset)

    def throttle(self, speed: float) -> float:
        """Throttle (share of full) that holds a speed [m/s]."""
        return self.offset + speed / self.gain

    def response(self, w: Array) -> NDArray[np.complex128]:
        """Frequency response (n,) [m/s per full throttle] at w (n,) rad/s."""
        return np.asarray(self.gain * np.exp(-1j * w * self.delay) / (1 + 1j * w * self.lag))


def simulated(model: SpeedModel, felt: Array, start: float, period: float) -> Array:
    """Speed (n,) [m/s] for a throttle (n,) that already includes the delay, from `start` [m/s]; exact for a
    throttle that is constant within a period [s]."""
    from scipy.signal import lfilter

    a = math.exp(-period / model.lag)
    pulled = model.gain * (felt - model.offset)
    return np.asarray(lfilter([0.0, 1.0 - a], [1.0, -a], pulled, zi=[start])[0])
