"""The roll mode, where a model without it was asked for."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="roll_dof",
    title="the body rolls",
    equation="(Ixx + ms h^2) p' + b_phi p + (k_phi - ms g h) phi = ms h (V_y' + V r)",
    source="roll-yaw model, equation (18) of the paper",
    parameters=(
        EffectParameter("k_phi", "N m/rad", 0.1, -9, 9, "roll stiffness", form="ratio"),
        EffectParameter("b_phi", "N m s/rad", 0.1, -9, 9, "roll damping", form="ratio"),
    ),
    stage="vehicle",
    shows="a_y, V_y' and p jointly, never r alone",
    apart="an IMU away from its place moves a_y alone",
    needs="a_y or p",
    excites="the roll mode, 15 to 30 rad/s",
    next_run="a sweep across the roll mode with p recorded",
    reads={"k_phi": "ln_k_phi", "b_phi": "ln_b_phi"},
    baselines=("kinematic", "bicycle"),
    channels=("ay", "p"),
)
