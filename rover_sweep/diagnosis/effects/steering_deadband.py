"""The servo does not respond to small commands.

    subtracted:  0 for abs(u) < w, else u - w sgn(u)
    full travel: 0 for abs(u) < w, else u

u: commanded road-wheel angle [rad]. w: half width of the band [rad], 0 to 0.15. Causes a third harmonic at
low frequency and adds no phase lag. A small amplitude shows it best; one sweep, or the rover on blocks. Tao
and Kokotovic 1996 (dead zone).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import EffectParameter, Values
from rover_sweep.diagnosis.effects.kinds import CommandEffect


def outside_band(steer: Array, q: Values) -> Array:
    """0 within w, u - w sgn(u) outside; steer (n,) rad."""
    return steer - np.clip(steer, -q["w"], q["w"])


def full_outside(steer: Array, q: Values) -> Array:
    """0 within w, u outside, with a transition of a tenth of w; steer (n,) rad."""
    if q["w"] <= 0:
        return steer
    return np.asarray(steer * np.clip((np.abs(steer) - q["w"]) / (0.1 * q["w"]) + 0.5, 0.0, 1.0))


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
    form="subtracted",
)

FORMS = (
    replace(
        EFFECT,
        first=False,
        form="full travel",
        equation="u -> 0 for abs(u) < w, else u",
        source="Tao and Kokotovic 1996, dead zone with a jump",
        act=full_outside,
    ),
)
