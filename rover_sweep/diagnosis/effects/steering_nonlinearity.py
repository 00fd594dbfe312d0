"""Steering gain that changes with the angle."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter, Values


def cubic(steer: Array, q: Values) -> Array:
    """u (1 + c3 u^2); steer (n,) rad. The stretch is held where the curve would turn back."""
    return steer * np.maximum(1.0 + q["c3"] * steer * steer, 0.1)


EFFECT = Effect(
    id="steering_nonlinearity",
    title="steering gain that changes with the angle",
    equation="d = u (1 + c3 u^2)",
    source="left_out_physics",
    parameters=(
        EffectParameter("c3", "1/rad^2", 3.0, -25.0, 25.0, "cubic stretch of the road-wheel angle", tiny=0.3),
    ),
    stage="linkage",
    shows="third harmonic at every frequency, residual power grows x23 when the amplitude doubles",
    apart="does not depend on frequency, where a rate limit does; tyres saturate with a_y",
    needs="two amplitudes",
    excites="large amplitude",
    next_run="servo on blocks: angle of the wheel at five commands from lock to lock",
    act=cubic,
)
