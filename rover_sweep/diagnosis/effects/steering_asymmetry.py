"""Different steering gain to the left and to the right."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter, Values


def uneven(steer: Array, q: Values) -> Array:
    """(1 + e) u to the left, (1 - e) u to the right; steer (n,) rad."""
    return steer + q["e"] * np.abs(steer)


EFFECT = Effect(
    id="steering_asymmetry",
    title="steering gain differs left and right",
    equation="d = (1 + e) u for u > 0 (left), (1 - e) u for u < 0",
    source="left_out_physics",
    parameters=(
        EffectParameter(
            "e",
            "-",
            0.1,
            -0.6,
            0.6,
            "half the difference of the gains left and right over their mean",
            tiny=0.01,
        ),
    ),
    stage="linkage",
    shows="second harmonic and a mean that follows the amplitude",
    apart="second harmonic only; a trim has a mean that does not follow the amplitude",
    needs="one sweep",
    excites="any amplitude",
    next_run="turning circles left and right at the same command",
    act=uneven,
)
