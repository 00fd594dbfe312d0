"""The side force of the tyres saturates.

    F = mu Fz tanh(C alpha/(mu Fz))

F: side force of an axle [N]. Fz: its static load [N]. alpha: slip angle [rad]. mu [-]: peak side force over
load, 1/6 and more (coordinate 1/mu). The residual power grows 16 times when the amplitude doubles, so it
needs two amplitudes; a large a_y shows it best. Pacejka 2012, with tanh in place of the magic formula.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import VehicleEffect

EFFECT = VehicleEffect(
    id="tyre_saturation",
    title="saturation of the tyres",
    equation="F = mu Fz tanh(C alpha/(mu Fz))",
    source="Pacejka 2012, with tanh in place of the magic formula",
    parameters=(
        EffectParameter(
            "mu",
            "-",
            1.2,
            0.0,
            6.0,
            "peak side force over the static axle load",
            form="inverse",
            tolerance=0.25,
        ),
    ),
    apart="depends on the side force; load transfer depends on a_y squared, a cubic gain on the angle",
    next_run="a sweep of double amplitude, and one at a second speed",
    fills={"mu": "inv_mu"},
    baselines=("roll-yaw", "bicycle"),
    signed=False,
)
