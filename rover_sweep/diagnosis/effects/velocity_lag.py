"""The velocity of the EKF lags.

    first order: T V_m' = V - V_m
    delay:       V_m(t) = V(t - T)

V, V_m: true and estimated velocity over ground [m/s], in earth axes, so that in a turn the lag takes T V r
from V_y as well. T [s], 0 to 1. Shows in V_y' and beta only; needs one
sweep with V_y recorded, and high frequencies show it best. GPS and EKF lag: ArduPilot issue 2850.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import Motion, NominalEffect, SensorEffect


def late_velocity(out: Mapping[str, Array], motion: Motion, q: Values) -> Mapping[str, Array]:
    """V_y {channel: (n,)} of the velocity that was T ago, in the body axes of now."""
    if "vy" not in out or q["T"] <= 0.0:
        return out
    t = motion["t"]
    begin = t - q["T"]
    turned = np.concatenate(([0.0], np.cumsum(0.5 * (motion["r"][1:] + motion["r"][:-1]) * np.diff(t))))
    angle = turned - np.interp(begin, t, turned)
    side, ahead = np.interp(begin, t, out["vy"]), np.interp(begin, t, motion["V"])
    return {**out, "vy": side * np.cos(angle) - ahead * np.sin(angle)}


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
    form="first order",
)

FORMS = (
    SensorEffect(
        id=EFFECT.id,
        title=EFFECT.title,
        equation="V_m(t) = V(t - T)",
        source="delay of a GPS velocity, EK3_VEL_DELAY",
        parameters=(
            EffectParameter("T", "s", 0.08, 0.0, 1.0, "delay of the velocity", tolerance=0.0, matters=0.01),
        ),
        apart=EFFECT.apart,
        next_run=EFFECT.next_run,
        channels=EFFECT.channels,
        signed=False,
        act=late_velocity,
        first=False,
        form="delay",
    ),
)
