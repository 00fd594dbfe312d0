"""Ground that changes at an instant."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter, Values


def changed(t: Array, q: Values) -> Array:
    """Factor of the stiffness: 1 before the instant t, the ratio from then on; t (n,) s."""
    return np.where(t >= q["t"], np.exp(q["ratio"]), 1.0)


EFFECT = Effect(
    id="surface_change",
    title="the ground changed",
    equation="C jumps to ratio C at t",
    source="left_out_physics",
    parameters=(
        EffectParameter("ratio", "-", 0.3, -1.6, 1.6, "C after over C before", form="ratio", tiny=0.015),
        EffectParameter("t", "s", 2.0, 0.0, 1e4, "instant, from the start of the run's manoeuvre"),
    ),
    stage="grip",
    shows="residual begins at an instant, in one run",
    apart="everything else is there throughout",
    needs="a repeat on one ground",
    excites="any",
    next_run="repeat the run on one ground",
    act=changed,
    material={"ratio": 0.08},
    baselines=("roll-yaw", "bicycle"),
)
