"""The wheels do not point straight ahead at the trim.

    d = u - u0

u, d: commanded and true road-wheel angle [rad]. u0 [rad], left positive, -0.3 to 0.3. Adds constants to r and
a_y in the ratio V; one sweep is enough, and straight driving shows it best.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import NominalEffect

EFFECT = NominalEffect(
    id="steering_trim",
    title="steering is not centred",
    equation="d = u - u0",
    source="definition of a trim",
    parameters=(
        EffectParameter(
            "u0",
            "rad",
            0.03,
            -0.3,
            0.3,
            "angle subtracted from the commanded one, left positive",
            matters=0.01,
            nominal="trim",
        ),
    ),
    apart="a tilted IMU changes a_y alone, at standstill too; a slope changes with the heading",
    next_run="drive straight without steering and measure the drift",
    releases={"trim": (-0.3, 0.3)},
)
