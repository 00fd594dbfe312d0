"""The IMU is not at the position that the vehicle file gives.

    a_y measured = a_y + x r' - z p'

x, z [m]: the IMU is further forward and further up than the vehicle file says. r', p': yaw and roll
acceleration [rad/s^2]. Bounds: -1 to 1 m. The error grows as w relative to r (x) and as w^2 relative to phi
(z), so high frequencies show it best; one sweep is enough, and so is a ruler. Acceleration of a point of a
rigid body.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import NominalEffect

KNOWN_TO = 0.005  # m, to which a vehicle file gives the CG and the roll axis

EFFECT = NominalEffect(
    id="imu_offset",
    title="the IMU is not where the vehicle file says",
    equation="a_y + x r' - z p'",
    source="acceleration of a point of a rigid body",
    parameters=(
        EffectParameter(
            "x",
            "m",
            0.05,
            -1.0,
            1.0,
            "IMU further forward than the file says",
            matters=0.012,
            doubt=KNOWN_TO,
            nominal="imu_x",
        ),
        EffectParameter(
            "z",
            "m",
            0.05,
            -1.0,
            1.0,
            "IMU further up than the file says",
            matters=0.012,
            doubt=KNOWN_TO,
            nominal="imu_z",
        ),
    ),
    apart="r and p are correct; a filter changes the phase and does not raise the gain",
    next_run="measure from the CG to the autopilot with a ruler",
    releases={"imu_x": (-1.0, 1.0), "imu_z": (-1.0, 1.0)},
    channels=("ay",),
)
