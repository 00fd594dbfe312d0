"""The wheels of an axle steer as the body rolls.

    front axle: front steering angle = d + e phi
    rear axle:  rear steering angle = e phi

d: road-wheel angle [rad]. phi: roll angle [rad]. e [-]: steering angle per roll angle, -3 to 3. Needs two
speeds; the roll mode shows it best. Milliken and Milliken 1995.
"""

from __future__ import annotations

from dataclasses import replace

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import VehicleEffect

EFFECT = VehicleEffect(
    id="roll_steer",
    title="roll steer of the front axle",
    equation="d + e phi",
    source="Milliken and Milliken 1995",
    parameters=(EffectParameter("e", "-", 0.3, -3.0, 3.0, "steering angle per roll angle", tolerance=0.02),),
    apart="changes the steady gain with the speed, as understeer does, but follows the roll mode",
    next_run="a sweep at a second speed across the roll mode",
    fills={"e": "e_roll"},
    baselines=("roll-yaw",),
    form="front axle",
)

FORMS = (
    replace(
        EFFECT,
        first=False,
        form="rear axle",
        title="roll steer of the rear axle",
        equation="rear steering angle = e phi",
        fills={"e": "e_rear"},
    ),
)
