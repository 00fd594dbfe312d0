"""The velocity of the EKF lags.

    T V_m' = V - V_m

V, V_m: true and estimated velocity over ground [m/s]. T [s], 0 to 1. Shows in V_y' and beta only; needs one
sweep with V_y recorded, and high frequencies show it best. GPS and EKF lag: ArduPilot issue 2850.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import NominalEffect

EFFECT = NominalEffect(
    id="velocity_lag",
    title="the EKF's velocity lags",
    equation="T V_m' = V - V_m",
    source="GPS and EKF lag, ArduPilot issue 2850",
    parameters=(
        EffectParameter(
            "T",
            "s",
            0.08,
            0.0,
            1.0,
            "time constant of the lag of the velocity",
            matters=0.01,
            nominal="vy_lag",
        ),
    ),
    apart="r and a_y are correct",
    next_run="read EK3_VEL_DELAY or the GPS delay; compare with a_y integrated",
    releases={"vy_lag": (0.0, 1.0)},
    channels=("vy",),
    signed=False,
)
