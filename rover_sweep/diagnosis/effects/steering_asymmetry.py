"""The steering gain differs to the left and to the right.

    two slopes: d = (1 + e) u for u > 0 (left),  (1 - e) u for u < 0
    quadratic:  d = u + e u^2/a,  a = 0.3 rad

u, d: angle before and after the linkage [rad]. e [-]: half the difference of the two gains over their mean
(at the angle a), -0.6 to 0.6. Causes a second harmonic only, and a mean; one sweep of any amplitude is
enough.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import LinkageEffect

REFERENCE = 0.3  # rad, at which both forms have the same gains


def uneven(steer: Array, q: Values) -> Array:
    """(1 + e) u to the left, (1 - e) u to the right; steer (n,) rad."""
    return steer + q["e"] * np.abs(steer)


def evenly_bent(steer: Array, q: Values) -> Array:
    """u + e u^2/a; steer (n,) rad."""
    return np.asarray(steer + q["e"] * steer * steer / REFERENCE)


EFFECT = LinkageEffect(
    id="steering_asymmetry",
    title="steering gain differs left and right",
    equation="d = (1 + e) u for u > 0 (left), (1 - e) u for u < 0",
    source="piecewise linear gain of the linkage",
    parameters=(
        EffectParameter(
            "e",
            "-",
            0.1,
            -0.6,
            0.6,
            "half the difference of the gains left and right over their mean",
            tolerance=0.01,
        ),
    ),
    apart="second harmonic only; the mean that a trim causes does not change with the amplitude",
    next_run="turning circles to the left and to the right at the same command",
    act=uneven,
    form="two slopes",
)

FORMS = (
    replace(
        EFFECT,
        first=False,
        form="quadratic",
        equation="d = u + e u^2/a, a = 0.3 rad",
        source="first even term of the series of any linkage",
        act=evenly_bent,
    ),
)
