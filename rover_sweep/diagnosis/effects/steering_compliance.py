"""The front side force turns the front wheels back.

    front steering angle = d - k F

F: side force of the front axle [N], left positive. k [rad/N], 0 to 0.05: compliance of column, linkage and
servo, with the tyres' trail. With linear tyres it lowers the front stiffness to C/(1 + k C), so only tyres
that saturate, or a known ratio of both axles, tell it from `front_rear_stiffness`. Milliken and Milliken
1995, chapter 23 (compliance steer).
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import VehicleEffect

EFFECT = VehicleEffect(
    id="steering_compliance",
    title="compliance of the steering",
    equation="d - k F_front",
    source="Milliken and Milliken 1995, compliance steer",
    parameters=(
        EffectParameter(
            "kC",
            "-",
            0.3,
            0.0,
            4.0,
            "angle lost over slip angle, k times the front stiffness",
            tolerance=0.05,
            matters=0.15,
        ),
    ),
    apart="grows with the side force; an uneven stiffness is the same for linear tyres",
    next_run="rover on blocks: turn a front wheel by hand with a spring balance, servo powered",
    fills={"kC": "compliance"},
    baselines=("roll-yaw", "bicycle"),
    signed=False,
)
