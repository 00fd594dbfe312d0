"""Axles of clearly different cornering stiffness."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="front_rear_stiffness",
    title="front and rear axle differ",
    equation="Cf != Cr, by more than 15 %",
    source="left_out_physics",
    parameters=(
        EffectParameter("ratio", "-", 0.35, -1.6, 1.6, "Cf/Cr, the geometric mean kept", form="ratio"),
    ),
    stage="vehicle",
    shows="absorbed by C, Izz and the gain at one speed",
    apart="understeer gradient: the steady gain's change with the speed",
    needs="two speeds",
    excites="low frequency at two speeds",
    next_run="steady circles at two speeds",
    reads={"ratio": "ln_ratio"},
    releases={"ln_ratio": (-1.6, 1.6)},
    material={"ratio": 0.15},
    baselines=("roll-yaw", "bicycle"),
    speeds=2,
)
