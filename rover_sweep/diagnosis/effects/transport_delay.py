"""Pure delay between command and wheel beyond the material size."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="transport_delay",
    title="transport delay of the steering",
    equation="d(t) = u(t - T)",
    source="pure delay, left_out_physics: beyond 40 ms alone or 70 ms with the servo's lag",
    parameters=(EffectParameter("T", "s", 0.06, 0.0, 0.5, "the whole pure delay"),),
    stage="servo",
    shows="phase proportional to frequency, gain flat, all channels equally",
    apart="a servo lag takes gain with the phase",
    needs="one sweep with known sensor filters",
    excites="high frequency",
    next_run="servo on blocks: a step of 100 us, time until the wheel moves",
    reads={"T": "delay"},
    releases={"delay": (0.0, 0.5)},
)
