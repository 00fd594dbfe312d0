"""Cornering drag lowers the speed.

    V' = (V_set - V)/tau_V - D a_y^2

D: loss [s^2/m], 0 to 2. It is judged in the measured speed, which also drives the simulation of all other
effects. A large a_y for a long time, that is low frequencies, shows it best; one sweep is enough. The drag is
the front side force times sin(d), which is proportional to a_y^2 for linear tyres.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import SpeedEffect

EFFECT = SpeedEffect(
    id="speed_variation",
    title="cornering drag lowers the speed",
    equation="V' = (V_set - V)/tau_V - D a_y^2",
    source="front side force times sin(d), for linear tyres",
    parameters=(
        EffectParameter(
            "D", "s^2/m", 0.02, 0.0, 2.0, "loss of speed per a_y squared", tolerance=0.002, matters=0.01
        ),
    ),
    apart="no other effect changes the speed with the square of a_y",
    next_run="the same sweep with the throttle held by hand, and with the speed controller",
    signed=False,
)
