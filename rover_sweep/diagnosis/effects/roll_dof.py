"""The body rolls, and the baseline has no roll.

    (Ixx + ms h^2) p' + b_phi p + (k_phi - ms g h) phi = ms h (V_y' + V r)

k_phi: roll stiffness [N m/rad]. b_phi: roll damping [N m s/rad]. Their start and bounds are those of the
roll-yaw model. Shows in a_y, V_y' and p, never in r alone; needs a_y or p. The roll mode of a small rover, 15
to 30 rad/s, shows it best. Equation (18) of the paper.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import DegreeOfFreedom

EFFECT = DegreeOfFreedom(
    id="roll_dof",
    title="the body rolls",
    equation="(Ixx + ms h^2) p' + b_phi p + (k_phi - ms g h) phi = ms h (V_y' + V r)",
    source="roll-yaw model, equation (18) of the paper",
    parameters=(
        EffectParameter("k_phi", "N m/rad", 0.1, -9, 9, "roll stiffness", form="ratio", nominal="ln_k_phi"),
        EffectParameter("b_phi", "N m s/rad", 0.1, -9, 9, "roll damping", form="ratio", nominal="ln_b_phi"),
    ),
    apart="a wrong IMU position changes a_y alone",
    next_run="a sweep across the roll mode with p recorded",
    baselines=("kinematic", "bicycle"),
    channels=("ay", "p"),
)
