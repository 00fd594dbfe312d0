"""Integration of a run at 1 kHz: Heun's method for the chassis, semi-implicit Euler for the steering.

Compiled in each process: numba's cache would not see a change in another file.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from tests.foreign.chassis import SHIFT, STATES, Array, derivative
from tests.foreign.numbers import Numbers
from tests.foreign.steering import STATES as STEERING_STATES
from tests.foreign.steering import steering_step

DT = 1e-3  # s
COLUMNS = ("u", "v", "r", "phi", "p", "psi", "v_dot", "r_dot", "p_dot", "delta", "gy", "shift")


@njit
def integrated(command: Array, wanted: Array, around: Array, start: Array, n: Numbers) -> Array:
    """(steps, 12) of COLUMNS from rest or from `start` (12,), at every DT.

    command (steps,) [rad] as the servo gets it; wanted (steps,) [m/s]; around (steps, 7) as in `derivative`.
    """
    steps = command.size
    out = np.empty((steps, 12))
    x, servo = start.copy(), np.zeros(STEERING_STATES)
    one, two, middle = np.zeros(15), np.zeros(15), np.zeros(STATES)
    delta = 0.0
    derivative(x, delta, around[0], wanted[0], n, one)
    for k in range(steps):
        new = steering_step(servo, command[k], x[0], one[12], one[13], n, DT)
        derivative(x, delta, around[k], wanted[k], n, one)
        for i in range(6):
            out[k, i] = x[i]
        out[k, 6], out[k, 7], out[k, 8] = one[1], one[2], one[4]
        out[k, 9], out[k, 10], out[k, 11] = delta, one[14], around[k, SHIFT]
        for i in range(STATES):
            middle[i] = x[i] + DT * one[i]
        derivative(middle, new, around[k], wanted[k], n, two)
        for i in range(STATES):
            x[i] += DT / 2 * (one[i] + two[i])
        delta = new
    return out
