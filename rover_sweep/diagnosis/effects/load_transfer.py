"""Lateral load transfer lowers the cornering stiffness.

    stiffness of both axles = C (1 - k (a_y/g)^2)

k [-]: loss of stiffness at a_y = g, 0 to 6. The factor is at least 0.05. Needs a large a_y. Milliken and
Milliken 1995 (load sensitivity of tyres).
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import VehicleEffect

EFFECT = VehicleEffect(
    id="load_transfer",
    title="lateral load transfer of the tyres",
    equation="C (1 - k (a_y/g)^2)",
    source="Milliken and Milliken 1995",
    parameters=(
        EffectParameter(
            "k", "-", 0.6, 0.0, 6.0, "loss of stiffness of both axles at a_y = g", tolerance=0.08
        ),
    ),
    apart="similar to tyre saturation, but depends on a_y alone and not on the slip angle",
    next_run="steady circles at rising speed: side force against slip angle",
    fills={"k": "k_load"},
    baselines=("roll-yaw", "bicycle"),
    signed=False,
)
