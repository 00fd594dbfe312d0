"""IMU elsewhere than the vehicle file says."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter

EFFECT = Effect(
    id="imu_offset",
    title="the IMU is not where the vehicle file says",
    equation="a_y + x r' - z p'",
    source="method.md, sensor position",
    parameters=(
        EffectParameter("x", "m", 0.05, -1.0, 1.0, "IMU further forward than the file says"),
        EffectParameter("z", "m", 0.05, -1.0, 1.0, "IMU further up than the file says"),
    ),
    stage="sensor",
    shows="a_y alone; x grows as w against r, z as w^2 against phi",
    apart="r and p are right, a filter would turn the phase without the gain rising",
    needs="one sweep; a ruler",
    excites="high frequency",
    next_run="a ruler: from the CG to the autopilot",
    reads={"x": "imu_x", "z": "imu_z"},
    releases={"imu_x": (-1.0, 1.0), "imu_z": (-1.0, 1.0)},
    doubt={"x": 0.005, "z": 0.005},  # to which a vehicle file knows the CG and the roll axis
    material={"x": 0.012, "z": 0.012},
    channels=("ay",),
)
