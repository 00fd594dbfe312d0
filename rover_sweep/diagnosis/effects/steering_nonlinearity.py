"""The steering gain changes with the angle.

    cubic:     d = u (1 + c3 u^2)
    quadratic: d = u (1 + c3 a abs(u)),  a = 0.3 rad

u, d: angle before and after the linkage [rad]. c3 [1/rad^2], -25 to 25; the factor is at least 0.1, so that
d never turns back. Causes a third harmonic at every frequency; the residual power grows 23 times when the
amplitude doubles, so it needs two amplitudes. A large amplitude shows it best.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import LinkageEffect

REFERENCE = 0.3  # rad, at which both forms have the same gain


def cubic(steer: Array, q: Values) -> Array:
    """u (1 + c3 u^2) with a factor of at least 0.1; steer (n,) rad."""
    return steer * np.maximum(1.0 + q["c3"] * steer * steer, 0.1)


def quadratic(steer: Array, q: Values) -> Array:
    """u (1 + c3 a abs(u)) with a factor of at least 0.1; steer (n,) rad."""
    return steer * np.maximum(1.0 + q["c3"] * REFERENCE * np.abs(steer), 0.1)


EFFECT = LinkageEffect(
    id="steering_nonlinearity",
    title="steering gain that changes with the angle",
    equation="d = u (1 + c3 u^2)",
    source="first odd term of the series of any symmetric linkage",
    parameters=(
        EffectParameter("c3", "1/rad^2", 3.0, -25.0, 25.0, "cubic term of the steering gain", tolerance=0.3),
    ),
    apart="does not depend on frequency, a rate limit does; tyre saturation depends on a_y",
    next_run="rover on blocks: angle of the wheel at five commands from lock to lock",
    act=cubic,
    form="cubic",
)

FORMS = (
    replace(
        EFFECT,
        first=False,
        form="quadratic",
        equation="d = u (1 + c3 a abs(u)), a = 0.3 rad",
        source="gain that changes from the centre on",
        act=quadratic,
    ),
)
