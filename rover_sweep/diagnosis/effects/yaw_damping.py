"""A yaw moment against the turn, as of a locked differential.

    over r:    M = -c r
    over r/V:  M = -c r/V

c [N m s], or [N m^2] over r/V, referred to the yaw inertia's scale: 0 and more. A locked axle drives both
wheels at one speed, so that their longitudinal slip makes a moment proportional to r/V; scrubbing tyres add
more. The nominal stiffness and gain take the place of most of it at one speed. Needs two speeds. Milliken
and Milliken 1995, chapter 20 (locked axle).
"""

from __future__ import annotations

from dataclasses import replace

from rover_sweep.diagnosis.effects.effect import EffectParameter
from rover_sweep.diagnosis.effects.kinds import VehicleEffect

EFFECT = VehicleEffect(
    id="yaw_damping",
    title="a yaw moment against the turn",
    equation="M = -c r",
    source="Milliken and Milliken 1995, locked axle",
    parameters=(
        EffectParameter(
            "c",
            "1/s",
            3.0,
            0.0,
            60.0,
            "moment per yaw rate, over the yaw inertia of the vehicle file (m a b without one)",
            tolerance=0.3,
            matters=1.0,
        ),
    ),
    apart="damps the yaw rate at all speeds; an uneven stiffness acts through the slip angles",
    next_run="the same sweep with the differential open, or at a second speed",
    fills={"c": "yaw_damp"},
    baselines=("roll-yaw", "bicycle"),
    signed=False,
    form="over r",
)

FORMS = (
    replace(
        EFFECT, first=False, form="over r/V", equation="M = -c r V0/V, V0 = 1 m/s", fills={"c": "yaw_damp_v"}
    ),
)
