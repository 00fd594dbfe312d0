"""A side wind, steady in direction.

    side force m (w_cos cos(psi) + w_sin sin(psi)) at the CG

psi: heading [rad], left positive from north. w [m/s^2]: force per mass, each component from -4 to 4. The
accelerometer measures it, unlike the weight on a slope. Needs a recorded heading; runs in opposite directions
show it best. Hucho 1998, chapter 5 (side wind).
"""

from __future__ import annotations

import numpy as np

from rover_sweep.diagnosis.effects.effect import EffectParameter, Reported, Values
from rover_sweep.diagnosis.effects.kinds import Force, ForceEffect, Motion


def pushed(motion: Motion, q: Values, mass: float) -> Force:
    """Side force [N] of the wind at the CG."""
    return mass * (q["w_cos"] * np.cos(motion["psi"]) + q["w_sin"] * np.sin(motion["psi"])), 0.0, 0.0


def from_where(found: Values) -> Reported:
    """Strength, and the heading at which the wind pushes to the left most."""
    c, s = found["w_cos"], found["w_sin"]
    return {
        "w": (float(np.hypot(c, s)), "m/s^2", "side force per mass"),
        "psi0": (
            float(np.arctan2(s, c)),
            "rad",
            "heading, left positive from north, of the largest push left",
        ),
    }


EFFECT = ForceEffect(
    id="side_wind",
    title="side wind",
    equation="m w cos(psi - psi0)",
    source="Hucho 1998, side wind",
    parameters=(
        EffectParameter("w_cos", "m/s^2", 0.4, -4.0, 4.0, "w cos(psi0)", tolerance=0.08, matters=0.2),
        EffectParameter("w_sin", "m/s^2", 0.4, -4.0, 4.0, "w sin(psi0)", tolerance=0.08, matters=0.2),
    ),
    apart="turns with the heading as a slope does, but the accelerometer measures it",
    next_run="the same run in the opposite direction, on a calm day",
    act=pushed,
    report_values=from_where,
    baselines=("roll-yaw", "bicycle"),
)
