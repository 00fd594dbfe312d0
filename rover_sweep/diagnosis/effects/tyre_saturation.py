"""Tyres that give less and less side force near their friction."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="tyre_saturation",
    title="saturation of the tyres",
    equation="F = mu Fz tanh(C alpha/(mu Fz))",
    source="Pacejka 2012; left_out_physics",
    parameters=(
        EffectParameter(
            "mu", "-", 1.2, 0.0, 6.0, "peak side force over the static axle load", form="inverse", tiny=0.25
        ),
    ),
    stage="vehicle",
    shows="gain falls with a_y, residual power x16 when the amplitude doubles",
    apart="follows the side force, where a load transfer follows a_y squared and a cubic the angle",
    needs="two amplitudes",
    excites="large a_y",
    next_run="a sweep of double amplitude, and one at a second speed",
    slots={"mu": "inv_mu"},
    baselines=("roll-yaw", "bicycle"),
    signed=False,
)
