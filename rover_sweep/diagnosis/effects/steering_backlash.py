"""Play in the steering linkage."""

from __future__ import annotations

import numpy as np
from numba import njit

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter, Values


@njit(cache=True, nogil=True)
def play(u: Array, half_gap: float) -> Array:
    """The output stays until the input has crossed the gap; u (n,) rad."""
    d = np.empty(u.size)
    x = u[0]
    for k in range(u.size):
        if u[k] - half_gap > x:
            x = u[k] - half_gap
        elif u[k] + half_gap < x:
            x = u[k] + half_gap
        d[k] = x
    return d


def backlash(steer: Array, q: Values) -> Array:
    """The play operator on the steering (n,) rad."""
    return play(steer, q["b"])


EFFECT = Effect(
    id="steering_backlash",
    title="backlash of the linkage",
    equation="play operator of half gap b",
    source="Tao and Kokotovic 1996; left_out_physics",
    parameters=(
        EffectParameter("b", "rad", 0.01, 0.0, 0.15, "half of the gap, road-wheel angle", tiny=0.0015),
    ),
    stage="linkage",
    shows="third harmonic and phase lag at all frequencies; grows only x1.6 with twice the amplitude",
    apart="has memory: the wheel lags by the gap at every reversal, where a deadband does not",
    needs="one sweep; servo on blocks",
    excites="reversals, small amplitude",
    next_run="servo on blocks: a slow ramp up and down, angle of the wheel against command",
    act=backlash,
    signed=False,
)
