"""The steering linkage has play.

    d stays until u has crossed the gap: d = u - b while u rises, u + b while u falls

    smooth hysteresis: d = u - b z,  z' = u'/b (1 - (z sgn(u'))) while moving (Bouc-Wen with n = 1)

u, d: angle before and after the linkage [rad]. b: half the gap [rad], 0 to 0.15. Causes a third harmonic and
a phase lag at all frequencies; the residual power grows only 1.6 times when the amplitude doubles. Reversals
at small amplitude show it best; one sweep, or the rover on blocks. Tao and Kokotovic 1996 (backlash).
"""

from __future__ import annotations

from dataclasses import replace

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


@njit(cache=True, nogil=True)
def hysteresis(u: Array, half_gap: float) -> Array:
    """u - b z (n,), z the Bouc-Wen variable with n = 1, exact between the samples of u (n,) rad."""
    d = np.empty(u.size)
    z, before = 0.0, u[0]
    for k in range(u.size):
        du = u[k] - before
        if du != 0.0:
            side = 1.0 if du > 0 else -1.0
            z = side - (side - z) * np.exp(-abs(du) / half_gap)
        before = u[k]
        d[k] = u[k] - half_gap * z
    return d


def smooth_hysteresis(steer: Array, q: Values) -> Array:
    """Bouc-Wen hysteresis of the steering (n,) rad."""
    return hysteresis(steer, q["b"]) if q["b"] > 0 else steer


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
    form="play",
)

FORMS = (
    replace(
        EFFECT,
        first=False,
        form="smooth hysteresis",
        equation="d = u - b z, b z' = u' - abs(u') z",
        source="Wen 1976, with n = 1",
        act=smooth_hysteresis,
    ),
)
