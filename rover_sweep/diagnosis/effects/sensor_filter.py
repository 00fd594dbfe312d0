"""Low-pass in a sensor's path that nobody knows of."""

from __future__ import annotations

from typing import Any

from rover_sweep.data.recording import Array, LowPass
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter, Values


def unknown(w: Array, q: Values) -> dict[str, Any]:
    """Responses (k,) of the hidden low-passes at w [rad/s]."""
    out = {}
    if q["gyro_hz"] > 0:
        out["r"] = out["p"] = LowPass(1.0 / q["gyro_hz"]).response(w)
    if q["accel_hz"] > 0:
        out["ay"] = LowPass(1.0 / q["accel_hz"]).response(w)
    return out


EFFECT = Effect(
    id="sensor_filter",
    title="an unknown sensor filter",
    equation="1/(1 + sqrt(2) s/w0 + (s/w0)^2), w0 = 2 pi f",
    source="ArduPilot LowPassFilter2p; left_out_physics",
    parameters=(
        EffectParameter(
            "gyro_hz", "Hz", 0.15, 0.0, 1.0, "cut-off of the low-pass on r and p", form="inverse", tiny=0.008
        ),
        EffectParameter(
            "accel_hz", "Hz", 0.15, 0.0, 1.0, "cut-off of the low-pass on a_y", form="inverse", tiny=0.008
        ),
    ),
    stage="filter",
    act=unknown,
    shows="unequal lag of r, p against a_y, V_y'",
    apart="a steering lag moves all channels alike",
    needs="one sweep",
    excites="high frequency",
    next_run="read INS_GYRO_FILTER and INS_ACCEL_FILTER, or log raw IMU",
    doubt={"gyro_hz": 0.007, "accel_hz": 0.007},  # s: 1.5 ms of any sensor's own delay
    material={"gyro_hz": 0.035, "accel_hz": 0.035},
    signed=False,
)
