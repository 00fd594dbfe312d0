"""Wheels that do not point straight ahead at the trim."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="steering_trim",
    title="steering is not centred",
    equation="d = u - u0",
    source="left_out_physics",
    parameters=(
        EffectParameter("u0", "rad", 0.03, -0.3, 0.3, "angle taken off the commanded one, left positive"),
    ),
    stage="linkage",
    shows="mean of r and a_y in the ratio V",
    apart="a tilted IMU moves a_y alone and at standstill too; a slope turns with the heading",
    needs="one sweep",
    excites="straight driving",
    next_run="drive straight hands off, read the drift",
    reads={"u0": "trim"},
    releases={"trim": (-0.3, 0.3)},
    material={"u0": 0.01},
)
