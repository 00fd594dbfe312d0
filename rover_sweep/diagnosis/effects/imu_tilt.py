"""The IMU is mounted at an angle.

    r + pitch p,  p - pitch r,  a_y - yaw a_x,  a_y + g sin(roll)

roll, pitch, yaw: mounting angles [rad], see the parameters for the signs; bounds -0.5 to 0.5 rad (yaw 0.6).
roll adds a constant to a_y, also at standstill, which is the nominal coordinate `bias_ay` [m/s^2]; pitch
mixes p and r, yaw mixes a_x and a_y. Needs standstill and two headings. Rotation of the sensor axes:
Titterton and Weston 2004, chapter 3.
"""

from __future__ import annotations

import numpy as np

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import Motion, SensorEffect


def rotated(measured: Motion, motion: Motion, q: Values) -> dict[str, Array]:
    """r and p rotated by the pitch angle, a_y by the yaw angle; the roll angle is in the bias of a_y."""
    out = dict(measured)
    c, s = np.cos(q["pitch"]), np.sin(q["pitch"])
    if "r" in measured and "p" in measured:
        out["r"] = c * measured["r"] + s * measured["p"]
        out["p"] = c * measured["p"] - s * measured["r"]
    if "ay" in measured:
        along = motion["v_dot_x"] - motion["r"] * motion["v"]
        out["ay"] = np.cos(q["yaw"]) * measured["ay"] - np.sin(q["yaw"]) * along
    return out


EFFECT = SensorEffect(
    id="imu_tilt",
    title="the IMU is mounted at an angle",
    equation="r + pitch p, p - pitch r, a_y - yaw a_x, a_y + g sin(roll)",
    source="rotation of the sensor axes; Titterton and Weston 2004, chapter 3",
    parameters=(
        EffectParameter(
            "roll",
            "rad",
            0.08,
            -0.5,
            0.5,
            "right side of the IMU down: a_y + g sin(roll)",
            tolerance=0.01,
            matters=0.0306,
            doubt=0.015,  # the bias of an accelerometer is up to 0.3 m/s^2
            nominal="bias_ay",
            per=GRAVITY,
        ),
        EffectParameter(
            "pitch",
            "rad",
            0.08,
            -0.5,
            0.5,
            "nose of the IMU down: yaw rate appears in p",
            tolerance=0.01,
            matters=0.02,
        ),
        EffectParameter(
            "yaw", "rad", 0.08, -0.6, 0.6, "IMU turned to the left", tolerance=0.01, matters=0.05
        ),
    ),
    apart="a slope changes with the heading; a trim changes r as well",
    next_run="a_y at standstill on a level floor at two headings",
    act=rotated,
    releases={"bias_ay": (-6.0, 6.0)},
)
