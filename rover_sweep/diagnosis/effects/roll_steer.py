"""Front wheels that steer as the body rolls."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="roll_steer",
    title="roll steer of the front axle",
    equation="d + e phi",
    source="Milliken and Milliken 1995; left_out_physics",
    parameters=(EffectParameter("e", "-", 0.3, -3.0, 3.0, "front steering angle per roll angle", tiny=0.02),),
    stage="vehicle",
    shows="follows the phase of the roll",
    apart="changes the steady gain with the speed as an understeer does, and follows the roll mode",
    needs="two speeds",
    excites="the roll mode",
    next_run="a sweep at a second speed across the roll mode",
    slots={"e": "e_roll"},
    baselines=("roll-yaw",),
    speeds=2,
)
