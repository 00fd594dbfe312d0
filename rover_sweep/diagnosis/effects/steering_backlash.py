"""The steering linkage has play.

    d stays until u has crossed the gap: d = u - b while u rises, u + b while u falls

u, d: angle before and after the linkage [rad]. b: half the gap [rad], 0 to 0.15. Causes a third harmonic and
a phase lag at all frequencies; the residual power grows only 1.6 times when the amplitude doubles. Reversals
at small amplitude show it best; one sweep, or the rover on blocks. Tao and Kokotovic 1996 (backlash).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import LinkageEffect


@njit(cache=True, nogil=True)
def play(u: Array, half_gap: float) -> Array:
    """The play operator: the output (n,) stays until the input u (n,) rad has crossed the gap."""
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


EFFECT = LinkageEffect(
    id="steering_backlash",
    title="backlash of the linkage",
    equation="play operator of half gap b",
    source="Tao and Kokotovic 1996, backlash",
    parameters=(
        EffectParameter("b", "rad", 0.01, 0.0, 0.15, "half of the gap, road-wheel angle", tolerance=0.0015),
    ),
    apart="the wheel lags by the gap at every reversal; with a deadband it does not",
    next_run="rover on blocks: a slow ramp up and down, angle of the wheel over command",
    act=backlash,
    signed=False,
)
