"""The axles have clearly different cornering stiffness.

    ratio = Cf/Cr, with sqrt(Cf Cr) = C kept

Cf, Cr: cornering stiffness of the front and rear axle [N/rad]. A ratio within 15 % of 1 is a normal tolerance
of the baseline. ln(ratio) from -1.6 to 1.6. At one speed C, Izz and the steering gain absorb it, so it needs
two speeds; low frequencies show it best. Gillespie 1992, chapter 6 (understeer gradient).
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import NominalEffect

EFFECT = NominalEffect(
    id="front_rear_stiffness",
    title="front and rear axle differ",
    equation="Cf != Cr, by more than 15 %",
    source="Gillespie 1992, chapter 6, understeer gradient",
    parameters=(
        EffectParameter(
            "ratio",
            "-",
            0.35,
            -1.6,
            1.6,
            "Cf/Cr, the geometric mean kept",
            form="ratio",
            matters=0.15,
            nominal="ln_ratio",
        ),
    ),
    apart="the steady gain changes with the speed (understeer gradient)",
    next_run="steady circles at two speeds",
    releases={"ln_ratio": (-1.6, 1.6)},
    baselines=("roll-yaw", "bicycle"),
)
