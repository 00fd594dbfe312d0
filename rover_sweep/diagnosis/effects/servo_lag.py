"""Steering servo slower than the material lag."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="servo_lag",
    title="slow steering servo",
    equation="T d' = u - d",
    source="first-order lag, left_out_physics: beyond 40 ms alone or 70 ms with the delay",
    parameters=(EffectParameter("T", "s", 0.06, 0.0, 0.5, "time constant of the whole first-order lag"),),
    stage="servo",
    shows="all channels alike, gain falls with phase",
    apart="a delay turns the phase and leaves the gain; a rate limit grows with the amplitude",
    needs="one sweep",
    excites="high frequency",
    next_run="servo on blocks: a step of 100 us, angle of the wheel against time",
    reads={"T": "lag"},
    releases={"lag": (0.0, 0.5)},
)
