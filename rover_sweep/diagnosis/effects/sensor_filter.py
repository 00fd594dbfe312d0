"""The signal of a sensor passes an unknown low-pass.

    second order:  1/(1 + sqrt(2) s/w0 + (s/w0)^2),  w0 = 2 pi f
    first order:   1/(1 + s/w0)
    delay:         exp(-s/w0)

f: cut-off [Hz], `gyro_hz` of r and p, `accel_hz` of a_y, 1 Hz and more (coordinate 1/f). Where the filter
is in the sensor, the estimator integrates the filtered r: its heading lags, and V_y changes by V times the
error.
Shows as a lag of
r and p that differs from that of a_y and V_y'; one sweep is enough, and high frequencies show it best.
The second order is a Butterworth low-pass, as ArduPilot's
LowPassFilter2p.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rover_sweep.data.recording import Array, LowPass
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import FilterEffect

_CHANNELS = (("r", "gyro_hz"), ("p", "gyro_hz"), ("ay", "accel_hz"))
OWN_DELAY = 0.007  # s of 1/f: 1.5 ms of the sensor's own delay


def hidden_low_passes(w: Array, q: Values) -> dict[str, Any]:
    """{channel: frequency response (k,)} at w (k,) rad/s."""
    out = {}
    if q["gyro_hz"] > 0:
        out["r"] = out["p"] = LowPass(1.0 / q["gyro_hz"]).response(w)
    if q["accel_hz"] > 0:
        out["ay"] = LowPass(1.0 / q["accel_hz"]).response(w)
    return out


def first_order(w: Array, q: Values) -> dict[str, Any]:
    """{channel: frequency response (k,)} of 1/(1 + s/w0) at w (k,) rad/s."""
    return {c: 1.0 / (1.0 + 1j * w / (2 * np.pi) * q[name]) for c, name in _CHANNELS if q[name] > 0}


def pure_delay(w: Array, q: Values) -> dict[str, Any]:
    """{channel: frequency response (k,)} of exp(-s/w0) at w (k,) rad/s."""
    return {c: np.exp(-1j * w / (2 * np.pi) * q[name]) for c, name in _CHANNELS if q[name] > 0}


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
    form="second order",
)

FORMS = (
    replace(
        EFFECT,
        first=False,
        form="first order",
        equation="1/(1 + s/w0), w0 = 2 pi f",
        source="first-order lag, ArduPilot LowPassFilter",
        response=first_order,
    ),
    replace(
        EFFECT,
        first=False,
        form="delay",
        equation="exp(-s/w0), w0 = 2 pi f",
        source="transport delay; 1/w0 is the delay",
        response=pure_delay,
    ),
    replace(
        EFFECT,
        first=False,
        form="first order, before the estimator",
        equation="1/(1 + s/w0), w0 = 2 pi f, and the heading integrates it",
        source="first-order lag in the sensor",
        response=first_order,
        heading=True,
    ),
    replace(
        EFFECT,
        first=False,
        form="second order, before the estimator",
        equation="1/(1 + sqrt(2) s/w0 + (s/w0)^2), w0 = 2 pi f, and the heading integrates it",
        heading=True,
    ),
)
