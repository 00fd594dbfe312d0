"""The servo does not respond to small commands.

    0 for abs(u) < w, else u - w sgn(u)

u: commanded road-wheel angle [rad]. w: half width of the band [rad], 0 to 0.15. Causes a third harmonic at
low frequency and adds no phase lag. A small amplitude shows it best; one sweep, or the rover on blocks. Tao
and Kokotovic 1996 (dead zone).
"""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import CommandEffect


def outside_band(steer: Array, q: Values) -> Array:
    """0 within w, u - w sgn(u) outside; steer (n,) rad."""
    return steer - np.clip(steer, -q["w"], q["w"])


EFFECT = CommandEffect(
    id="steering_deadband",
    title="deadband of the steering",
    equation="e -> 0 for abs(e) < w, else e - w sgn(e)",
    source="Tao and Kokotovic 1996, dead zone",
    parameters=(
        EffectParameter(
            "w", "rad", 0.01, 0.0, 0.15, "half width of the band, road-wheel angle", tolerance=0.001
        ),
    ),
    apart="adds no phase lag, a backlash does; its share grows as the amplitude falls",
    next_run="rover on blocks: a slow ramp up and down, angle of the wheel over command",
    act=outside_band,
    signed=False,
)
