"""A sensor has a wrong scale.

    measured = (1 + s) true

s [-]: of both gyros, and of the accelerometer, -0.5 to 0.5. The steering's scale and the speed take the place
of a gyro's scale unless a_y = V r + v' holds them; the recorded V_y helps. One sweep is enough. Titterton
and Weston 2004 (scale factor error).
"""

from __future__ import annotations

from collections.abc import Mapping

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import Motion, SensorEffect


def scaled(out: Mapping[str, Array], motion: Motion, q: Values) -> Mapping[str, Array]:
    """The channels {channel: (n,)} with the scale errors."""
    factors = {"r": 1.0 + q["gyro"], "p": 1.0 + q["gyro"], "ay": 1.0 + q["accel"]}
    return {c: y * factors.get(c, 1.0) for c, y in out.items()}


EFFECT = SensorEffect(
    id="sensor_scale",
    title="a sensor with a wrong scale",
    equation="measured = (1 + s) true",
    source="Titterton and Weston 2004, scale factor error",
    parameters=(
        EffectParameter("gyro", "-", 0.08, -0.5, 0.5, "scale error of r and p", tolerance=0.01, matters=0.03),
        EffectParameter("accel", "-", 0.08, -0.5, 0.5, "scale error of a_y", tolerance=0.01, matters=0.03),
    ),
    apart="a wrong steering scale changes r and a_y alike",
    next_run="turn the rover by hand by ten full turns; tilt it by a known angle",
    act=scaled,
)
