"""Cornering stiffness that falls with the square of a_y."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="load_transfer",
    title="lateral load transfer of the tyres",
    equation="C (1 - k (a_y/g)^2)",
    source="Milliken and Milliken 1995; left_out_physics",
    parameters=(
        EffectParameter("k", "-", 0.6, 0.0, 6.0, "loss of stiffness of both axles at a_y = g", tiny=0.08),
    ),
    stage="vehicle",
    shows="gain falls with a_y",
    apart="nearly a tyre saturation; depends on a_y alone and not on the slip",
    needs="large amplitude",
    excites="large a_y",
    next_run="steady circles at rising speed: side force against slip angle",
    slots={"k": "k_load"},
    baselines=("roll-yaw", "bicycle"),
    signed=False,
)
