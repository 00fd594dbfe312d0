"""EKF velocity that lags the rover."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="velocity_lag",
    title="the EKF's velocity lags",
    equation="T V_m' = V - V_m",
    source="GPS and EKF lag, ArduPilot #2850; left_out_physics",
    parameters=(EffectParameter("T", "s", 0.08, 0.0, 1.0, "time constant of the lag of the velocity"),),
    stage="sensor",
    shows="V_y' and beta only",
    apart="r and a_y are right",
    needs="one sweep with V_y recorded",
    excites="high frequency",
    next_run="read EK3_VEL_DELAY or the GPS delay; compare with a_y integrated",
    reads={"T": "vy_lag"},
    releases={"vy_lag": (0.0, 1.0)},
    material={"T": 0.01},
    channels=("vy",),
    signed=False,
)
