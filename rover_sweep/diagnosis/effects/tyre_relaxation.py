"""Side force that builds up over a distance."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="tyre_relaxation",
    title="relaxation length of the tyres",
    equation="(sigma/V) F' + F = F0",
    source="Pacejka 2012, chapter 5",
    parameters=(EffectParameter("sigma", "m", 0.15, 0.0, 1.5, "relaxation length of both axles", tiny=0.01),),
    stage="vehicle",
    shows="lag that shrinks as 1/V, inside the yaw damping",
    apart="the lag of a servo or a delay does not change with the speed",
    needs="two speeds",
    excites="high frequency, low speed",
    next_run="the same sweep at half the speed",
    slots={"sigma": "sigma"},
    baselines=("roll-yaw", "bicycle"),
    speeds=2,
    signed=False,
)
