"""The ground changes at an instant of one run.

    stiffness of both axles = C before t, ratio C from t on

ratio [-]: ln(ratio) from -1.6 to 1.6. t [s]: from the start of the run's manoeuvre. The residual begins at
that instant, in one run; a repeat of the run on one ground confirms it.
"""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import GripEffect


def stiffness_factor(t: Array, q: Values) -> Array:
    """Factor of the stiffness (n,): 1 before the instant, the ratio from then on; t (n,) s."""
    return np.where(t >= q["t"], np.exp(q["ratio"]), 1.0)


EFFECT = GripEffect(
    id="surface_change",
    title="the ground changed",
    equation="C jumps to ratio C at t",
    source="step change of the cornering stiffness",
    parameters=(
        EffectParameter(
            "ratio", "-", 0.3, -1.6, 1.6, "C after over C before", form="ratio", tolerance=0.015, matters=0.08
        ),
        EffectParameter("t", "s", 2.0, 0.0, 1e4, "instant, from the start of the run's manoeuvre"),
    ),
    apart="all other effects act during the whole run",
    next_run="repeat the run on one ground",
    act=stiffness_factor,
    baselines=("roll-yaw", "bicycle"),
)
