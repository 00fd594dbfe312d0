"""Dry friction in the suspension."""

from __future__ import annotations

from rover_sweep.identify.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="suspension_friction",
    title="dry friction of the suspension",
    equation="T sgn p against the roll",
    source="left_out_physics",
    parameters=(
        EffectParameter("T", "N m", 0.03, 0.0, 1.5, "friction torque against the roll rate", tiny=0.002),
    ),
    stage="vehicle",
    shows="p and what follows from it; inflates b_phi",
    apart="its share falls with the amplitude; a damper's does not",
    needs="two amplitudes with p recorded",
    excites="small roll rates",
    next_run="a sweep at half the amplitude across the roll mode",
    slots={"T": "T_roll"},
    baselines=("roll-yaw",),
    channels=("p",),
    signed=False,
)
