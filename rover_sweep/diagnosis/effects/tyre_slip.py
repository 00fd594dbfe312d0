"""The tyres slip sideways, and the kinematic baseline has no slip.

    F = -C alpha,  Izz r' = a Ff - b Fr

C: cornering stiffness of an axle [N/rad], mean of both. Izz: yaw inertia about the CG [kg m^2]. alpha: slip
angle [rad]. Their start and bounds are those of the bicycle model. r lags and V_y is not zero, more so with
speed; one sweep is enough, and high frequency at high speed shows it best. Equation (17) of the paper.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import DegreeOfFreedom

EFFECT = DegreeOfFreedom(
    id="tyre_slip",
    title="tyres that slip sideways, and yaw inertia",
    equation="F = -C alpha, Izz r' = a Ff - b Fr",
    source="bicycle model, equation (17) of the paper",
    parameters=(
        EffectParameter(
            "C",
            "N/rad",
            0.1,
            -9,
            9,
            "cornering stiffness of an axle, mean of both",
            form="ratio",
            nominal="ln_C",
        ),
        EffectParameter(
            "Izz", "kg m^2", 0.1, -9, 9, "yaw inertia about the CG", form="ratio", nominal="ln_Izz"
        ),
    ),
    apart="a servo has the same lag at every speed; with slip the lag and the steady gain change with V",
    next_run="the same sweep at a second speed",
    baselines=("kinematic",),
)
