"""Side force of one wheel from its slip angle.

Forms (tyre_form): 0 linear; 1 Fiala, the brush with parabolic pressure (Fiala 1954; Pacejka 2012, 3.1); 2
Magic Formula with a shape factor of 1.6, which falls past its peak (Pacejka 2012, 4.E1); 3 tanh; 4 Dugoff
(Dugoff et al. 1970); 5 arctangent; 6 exponential.
load_form: how the stiffness follows the wheel load: 1 a parabola, 2 a power law, 3 sin(2 atan) (Pacejka 2012,
4.E25), 4 none of it is lost down to half of the nominal load, all where the wheel lifts.
"""

from __future__ import annotations

import math

from numba import njit

SHAPE = 1.6


@njit(cache=True)
def side_force(alpha: float, stiffness: float, limit: float, form: float) -> float:
    """Side force [N] against the slip angle `alpha` [rad]: odd, slope -stiffness at zero, below `limit`."""
    s = math.tan(max(-1.4, min(1.4, alpha)))
    z = stiffness * abs(s) / limit
    if form == 0.0:
        return -stiffness * alpha
    if form == 1.0:
        share = z - z * z / 3 + z * z * z / 27 if z < 3.0 else 1.0
    elif form == 2.0:
        share = math.sin(SHAPE * math.atan(z / SHAPE))
    elif form == 3.0:
        share = math.tanh(z)
    elif form == 4.0:
        share = z if z < 0.5 else 1.0 - 0.25 / z
    elif form == 5.0:
        share = 2 / math.pi * math.atan(math.pi / 2 * z)
    else:
        share = 1.0 - math.exp(-z)
    return -math.copysign(limit * share, alpha)


@njit(cache=True)
def load_factor(load: float, nominal: float, k: float, form: float) -> float:
    """Stiffness at a wheel load over that at the nominal load, 1 at the nominal load, 0 at zero load."""
    f = max(load, 0.0) / nominal
    if form == 1.0:
        return max(0.0, f - k * (f - 1.0) ** 2) if f < 1.0 + 0.5 / max(k, 1e-9) else 1.0 + 0.25 / max(k, 1e-9)
    if form == 2.0:
        return f ** (1.0 - k)
    if form == 3.0:
        c = 1.0 / max(k, 1e-9)  # load of the largest stiffness, over the nominal load
        return math.sin(2 * math.atan(f / c)) / math.sin(2 * math.atan(1.0 / c))
    if form == 4.0:
        return min(1.0, 2 * f)
    return 1.0


@njit(cache=True)
def dead_zone(alpha: float, half: float) -> float:
    """The slip angle beyond a zone without force."""
    return math.copysign(max(abs(alpha) - half, 0.0), alpha)
