"""The ground slopes.

    a_y measured = a_y + g b cos(psi - psi0)

b: slope [rad]. psi, psi0: heading and the heading of the largest +a_y [rad], left positive from north. The
weight pulls the rover to the low side; the accelerometer measures the tyre force that holds it. Fitted as
b cos(psi0) and b sin(psi0), each from -0.4 to 0.4 rad. Needs a recorded heading; runs in opposite directions
show it best. Rajamani 2012, chapter 2 (road bank angle).
"""

from __future__ import annotations

import numpy as np

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.diagnosis.effects.effect import EffectParameter, Reported, Values
from rover_sweep.diagnosis.effects.kinds import Force, ForceEffect, Motion


def weight_across(motion: Motion, q: Values, mass: float) -> Force:
    """Lateral part of the weight [N], and its roll moment on the sprung mass about the roll axis [N m]."""
    side = q["b_cos"] * np.cos(motion["psi"]) + q["b_sin"] * np.sin(motion["psi"])
    return -mass * GRAVITY * side, 0.0, motion["ms_h"] * GRAVITY * side


def slope(found: Values) -> Reported:
    """Slope b and the heading psi0 of the largest +a_y."""
    c, s = found["b_cos"], found["b_sin"]
    return {
        "b": (float(np.hypot(c, s)), "rad", "slope of the ground"),
        "psi0": (float(np.arctan2(s, c)), "rad", "heading, left positive from north, of the largest +a_y"),
    }


EFFECT = ForceEffect(
    id="cross_slope",
    title="the ground slopes",
    equation="a_y + g b cos(psi - psi0)",
    source="Rajamani 2012, chapter 2, road bank angle",
    parameters=(
        EffectParameter("b_cos", "rad", 0.04, -0.4, 0.4, "b cos(psi0)", tolerance=0.008, matters=0.02),
        EffectParameter("b_sin", "rad", 0.04, -0.4, 0.4, "b sin(psi0)", tolerance=0.008, matters=0.02),
    ),
    apart="a tilted IMU and a trim do not change with the heading",
    next_run="the same run in the opposite direction",
    act=weight_across,
    weight=True,
    report_values=slope,
)
