"""The steering scale of the vehicle file is wrong.

    d = (1 + s) u

u, d: road-wheel angle by the file's rad_per_us, and the true one [rad]. s [-], -0.6 to 1. No physics of the
rover: a number to measure, and the first thing to measure where it is a finding. One sweep is enough.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import NominalEffect

EFFECT = NominalEffect(
    id="steering_scale",
    title="wrong steering scale (rad_per_us)",
    equation="d = (1 + s) u",
    source="definition of a scale",
    parameters=(
        EffectParameter(
            "s",
            "-",
            0.1,
            -0.6,
            1.0,
            "relative error of rad_per_us, positive where the wheels turn farther",
            matters=0.08,
            nominal="scale",
        ),
    ),
    apart="changes r and a_y alike at all frequencies and amplitudes",
    next_run="measure the angle of a wheel at three pulse widths with the rover on blocks (bench)",
    baselines=("roll-yaw", "bicycle", "kinematic"),
    releases={"scale": (-0.6, 1.0)},
)
