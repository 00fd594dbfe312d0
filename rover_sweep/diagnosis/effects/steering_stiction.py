"""The servo moves only past an error, then all the way.

    no memory:   d stays until abs(u - d) > s, then d = u at once, and stays again
    with memory: d stays until abs(u - d) > s, then follows u until u turns back

u, d: commanded and reached angle [rad]. s: largest error at rest [rad], 0 to 0.15. Many digital servos have
such a band against hunting. It causes steps at small amplitude, and a lag of half of s on average.
Armstrong-Helouvry 1994 (stiction); a small amplitude shows it best, on blocks it is seen by eye.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import CommandEffect


@njit(cache=True, nogil=True)
def jumps(u: Array, band: float) -> Array:
    """The angle (n,) that is held until the command u (n,) is more than the band away, then taken from u."""
    d = np.empty(u.size)
    x = u[0]
    for k in range(u.size):
        if abs(u[k] - x) > band:
            x = u[k]
        d[k] = x
    return d


@njit(cache=True, nogil=True)
def sticks(u: Array, band: float) -> Array:
    """The angle (n,) that is held until u (n,) is more than the band away.

    Then follows until u turns back.
    """
    d = np.empty(u.size)
    x, way, before = u[0], 0.0, u[0]
    for k in range(u.size):
        du = u[k] - before
        before = u[k]
        if way != 0.0 and du * way < 0.0:
            way = 0.0
        if way == 0.0 and abs(u[k] - x) > band:
            way = 1.0 if u[k] > x else -1.0
        if way != 0.0:
            x = u[k]
        d[k] = x
    return d


def _jumping(steer: Array, q: Values) -> Array:
    return jumps(steer, q["s"]) if q["s"] > 0 else steer


def _sticking(steer: Array, q: Values) -> Array:
    return sticks(steer, q["s"]) if q["s"] > 0 else steer


EFFECT = CommandEffect(
    id="steering_stiction",
    title="steering that sticks",
    equation="d stays until abs(u - d) > s, then d = u",
    source="Armstrong-Helouvry 1994, stiction; position band of a digital servo",
    parameters=(
        EffectParameter(
            "s",
            "rad",
            0.012,
            0.0,
            0.15,
            "largest error at rest, road-wheel angle",
            tolerance=0.0015,
            jumps=True,
        ),
    ),
    apart="goes all the way once it moves; with a backlash or a deadband a part stays lost",
    next_run="rover on blocks: a slow ramp, angle of the wheel over command",
    act=_jumping,
    signed=False,
    form="no memory",
)

FORMS = (
    replace(
        EFFECT,
        first=False,
        form="with memory",
        equation="d stays until abs(u - d) > s, then follows u until u turns back",
        act=_sticking,
    ),
)
