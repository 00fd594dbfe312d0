"""The suspension has dry friction.

    roll moment = -T tanh(p/w), which is -T sgn(p) for a small w

p: roll rate [rad/s]. T: friction torque [N m], 0 to half of ms g h. w = 0.01 rad/s exp(`width`): smoothing of
the sign, a number of the simulation and not of the rover. Inflates the roll damping b_phi; its share falls
with the amplitude, so it needs p at two amplitudes. Small roll rates show it best. Coulomb friction:
Armstrong-Helouvry, Dupont and Canudas de Wit 1994.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter, Reported, Values
from rover_sweep.diagnosis.effects.kinds import VehicleEffect


def torque(found: Values) -> Reported:
    """The friction torque alone; the width of its smoothing is not a property of the rover."""
    return {"T": (found["T"], "N m", "friction torque against the roll rate")}


EFFECT = VehicleEffect(
    id="suspension_friction",
    title="dry friction of the suspension",
    equation="T sgn p against the roll",
    source="Coulomb friction; Armstrong-Helouvry, Dupont and Canudas de Wit 1994",
    parameters=(
        EffectParameter(
            "T",
            "N m",
            0.03,
            0.0,
            1.5,
            "friction torque against the roll rate",
            tolerance=0.002,
            grows_with="roll moment",
        ),
        EffectParameter("width", "-", 0.7, -2.0, 2.0, "ln of the roll rate of the smoothing over 0.01 rad/s"),
    ),
    apart="its share falls as the amplitude grows; the share of a damper does not",
    next_run="a sweep at half the amplitude across the roll mode",
    fills={"T": "T_roll", "width": "ln_width"},
    report_values=torque,
    baselines=("roll-yaw",),
    channels=("p",),
    signed=False,
)
