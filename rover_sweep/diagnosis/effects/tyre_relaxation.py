"""The side force of the tyres builds up over a distance.

    (sigma/V) F' + F = F0

F0: steady side force of an axle [N]. V [m/s]. sigma: relaxation length of both axles [m], 0 to 3 wheelbases.
Its lag is proportional to 1/V and adds to the yaw damping, so it needs two speeds; high frequency at low
speed shows it best. Pacejka 2012, chapter 5.
"""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import VehicleEffect

EFFECT = VehicleEffect(
    id="tyre_relaxation",
    title="relaxation length of the tyres",
    equation="(sigma/V) F' + F = F0",
    source="Pacejka 2012, chapter 5",
    parameters=(
        EffectParameter(
            "sigma",
            "m",
            0.15,
            0.0,
            1.5,
            "relaxation length of both axles",
            tolerance=0.01,
            grows_with="wheelbase",
        ),
    ),
    apart="the lag of a servo or a delay does not change with the speed",
    next_run="the same sweep at half the speed",
    fills={"sigma": "sigma"},
    baselines=("roll-yaw", "bicycle"),
    signed=False,
)
