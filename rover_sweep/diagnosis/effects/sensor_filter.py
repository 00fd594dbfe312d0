"""The signal of a sensor passes an unknown low-pass.

    1/(1 + sqrt(2) s/w0 + (s/w0)^2),  w0 = 2 pi f

f: cut-off [Hz], `gyro_hz` of r and p, `accel_hz` of a_y, 1 Hz and more (coordinate 1/f). Shows as a lag of
r and p that differs from that of a_y and V_y'; one sweep is enough, and high frequencies show it best.
Second-order Butterworth, as ArduPilot's LowPassFilter2p.
"""

from __future__ import annotations

from typing import Any

from rover_sweep.data.recording import Array, LowPass
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import FilterEffect

OWN_DELAY = 0.007  # s of 1/f: 1.5 ms of the sensor's own delay


def hidden_low_passes(w: Array, q: Values) -> dict[str, Any]:
    """{channel: frequency response (k,)} at w (k,) rad/s."""
    out = {}
    if q["gyro_hz"] > 0:
        out["r"] = out["p"] = LowPass(1.0 / q["gyro_hz"]).response(w)
    if q["accel_hz"] > 0:
        out["ay"] = LowPass(1.0 / q["accel_hz"]).response(w)
    return out


def _cutoff(name: str, convention: str) -> EffectParameter:
    return EffectParameter(
        name,
        "Hz",
        0.15,
        0.0,
        1.0,
        convention,
        form="inverse",
        tolerance=0.008,
        matters=0.035,
        doubt=OWN_DELAY,
    )


EFFECT = FilterEffect(
    id="sensor_filter",
    title="an unknown sensor filter",
    equation="1/(1 + sqrt(2) s/w0 + (s/w0)^2), w0 = 2 pi f",
    source="second-order Butterworth, ArduPilot LowPassFilter2p",
    parameters=(
        _cutoff("gyro_hz", "cut-off of the low-pass on r and p"),
        _cutoff("accel_hz", "cut-off of the low-pass on a_y"),
    ),
    apart="a steering lag delays all channels equally",
    next_run="read INS_GYRO_FILTER and INS_ACCEL_FILTER, or log raw IMU",
    response=hidden_low_passes,
    signed=False,
)
