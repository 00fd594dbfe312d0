"""The side force of the tyres saturates.

    tanh:   F = mu Fz tanh(z),  z = C alpha/(mu Fz)
    brush:  F = mu Fz (z - z^2/3 + z^3/27) up to z = 3, mu Fz beyond
    falling peak:  F = mu Fz sin(1.6 atan(z/1.6))
    knee:   F = mu Fz z/(1 + z^6)^(1/6)

F: side force of an axle [N]. Fz: its static load [N]. alpha: slip angle [rad]. mu [-]: peak side force over
load, 1/6 and more (coordinate 1/mu). The residual power grows 16 times when the amplitude doubles, so it
needs two amplitudes; a large a_y shows it best. Pacejka 2012: brush model in chapter
3, magic formula in chapter 4, of which the third form has the shape factor 1.6.
"""

from __future__ import annotations

from dataclasses import replace

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
            2.0,
            0.0,
            6.0,
            "peak side force over the static axle load",
            form="inverse",
            matters=1.4,  # a peak of 0.7 of the load and more is a normal tyre, the bend of the nominal model
        ),
    ),
    apart="depends on the side force; load transfer depends on a_y squared, a cubic gain on the angle",
    next_run="a sweep of double amplitude, and one at a second speed",
    fills={"mu": "inv_mu"},
    baselines=("roll-yaw", "bicycle"),
    releases={"bend": (0.0, 0.0)},  # the nominal bend is the beginning of the same law
    signed=False,
    form="tanh",
)

FORMS = (
    replace(
        EFFECT,
        first=False,
        form="brush",
        equation="F = mu Fz (z - z^2/3 + z^3/27), z = C alpha/(mu Fz) up to 3",
        source="Pacejka 2012, chapter 3, brush model",
        sets={"tyre_form": 1.0},
    ),
    replace(
        EFFECT,
        first=False,
        form="falling peak",
        equation="F = mu Fz sin(1.6 atan(C alpha/(1.6 mu Fz)))",
        source="Pacejka 2012, chapter 4, magic formula with the shape factor 1.6",
        sets={"tyre_form": 2.0},
    ),
    replace(
        EFFECT,
        first=False,
        form="knee",
        equation="F = C alpha/(1 + (C alpha/(mu Fz))^6)^(1/6)",
        source="a linear tyre up to Coulomb's limit, as a rigid wheel on dry ground",
        sets={"tyre_form": 3.0},
    ),
)
