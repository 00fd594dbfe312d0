"""Speed lost in the turns."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="speed_variation",
    title="cornering drag takes speed",
    equation="V' = (V_set - V)/tau_V - D a_y^2",
    source="Rajamani 2012, chapter 2; left_out_physics",
    parameters=(EffectParameter("D", "s^2/m", 0.02, 0.0, 2.0, "loss of speed per a_y squared", tiny=0.002),),
    stage="speed",
    shows="the measured speed itself: even in the steering, at low frequency",
    apart="nothing else moves the speed with the square of a_y",
    needs="one sweep",
    excites="large a_y for long",
    next_run="hold the throttle by hand and by the speed controller, the same sweep",
    material={"D": 0.01},
    signed=False,
)
