"""IMU mounted askew."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter, Motion, Values


def tilted(measured: Motion, motion: Motion, q: Values) -> dict[str, Array]:
    """r, p turned by the pitch angle, a_y by yaw; the constant of the roll angle is the nominal's bias."""
    out = dict(measured)
    c, s = np.cos(q["pitch"]), np.sin(q["pitch"])
    if "r" in measured and "p" in measured:
        out["r"] = c * measured["r"] + s * measured["p"]
        out["p"] = c * measured["p"] - s * measured["r"]
    if "ay" in measured:
        along = motion["v_dot_x"] - motion["r"] * motion["v"]
        out["ay"] = np.cos(q["yaw"]) * measured["ay"] - np.sin(q["yaw"]) * along
    return out


EFFECT = Effect(
    id="imu_tilt",
    title="the IMU is mounted askew",
    equation="r + pitch p, p - pitch r, a_y - yaw a_x, a_y + g sin(roll)",
    source="rotation of the sensor's axes; left_out_physics",
    parameters=(
        EffectParameter(
            "roll",
            "rad",
            0.08,
            -0.5,
            0.5,
            "IMU's y axis turned down on its right: a_y + g sin(roll)",
            tiny=0.01,
        ),
        EffectParameter("pitch", "rad", 0.08, -0.5, 0.5, "nose of the IMU down: yaw shows in p", tiny=0.01),
        EffectParameter("yaw", "rad", 0.08, -0.6, 0.6, "IMU turned to the left", tiny=0.01),
    ),
    stage="sensor",
    shows="a constant of a_y whatever the heading, and mixing of p and r, of a_x and a_y",
    apart="a slope turns with the heading; a trim moves r as well",
    needs="standstill and two headings",
    excites="standstill",
    next_run="standing still on a level floor at two headings: a_y",
    act=tilted,
    reads={"roll": "bias_ay"},
    per={"roll": GRAVITY},
    releases={"bias_ay": (-6.0, 6.0)},
    doubt={"roll": 0.015},  # an accelerometer's own bias is up to .3 m/s^2
    material={"roll": 0.0306, "pitch": 0.02, "yaw": 0.05},
)
