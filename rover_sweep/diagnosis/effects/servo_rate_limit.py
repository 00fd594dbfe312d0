"""Servo that cannot turn faster than its rated speed."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="servo_rate_limit",
    title="rate limit of the servo",
    equation="abs(d') <= R",
    source="slew limit of RC servos; left_out_physics",
    parameters=(
        EffectParameter(
            "R", "rad/s", 0.4, 0.0, 3.0, "fastest rate of the road wheel's angle", form="inverse", tiny=0.03
        ),
    ),
    stage="servo",
    shows="high frequency, third harmonic, residual power grows about x17 when the amplitude doubles",
    apart="grows with amplitude and frequency; a lag does not grow, a cubic does not depend on frequency",
    needs="two amplitudes",
    excites="large amplitude at high frequency",
    next_run="a second sweep at half the amplitude, or the servo on blocks with a large step",
    slots={"R": "inv_rate"},
    material={"R": 0.25},  # servos are sold with .10 to .20 s per 60 deg, 5 to 10 rad/s
    signed=False,
)
