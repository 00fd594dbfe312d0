"""Tyres with slip angles, where the kinematic model was asked for."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="tyre_slip",
    title="tyres that slip sideways, and yaw inertia",
    equation="F = -C alpha, Izz r' = a Ff - b Fr",
    source="bicycle model, equation (17) of the paper",
    parameters=(
        EffectParameter(
            "C", "N/rad", 0.1, -9, 9, "cornering stiffness of an axle, mean of both", form="ratio"
        ),
        EffectParameter("Izz", "kg m^2", 0.1, -9, 9, "yaw inertia about the CG", form="ratio"),
    ),
    stage="vehicle",
    shows="r lags and V_y is not zero, more with speed",
    apart="a servo lags at every speed alike; slip lags with V and bends the steady gain",
    needs="one sweep",
    excites="high frequency, high speed",
    next_run="the same sweep at a second speed",
    reads={"C": "ln_C", "Izz": "ln_Izz"},
    baselines=("kinematic",),
)
