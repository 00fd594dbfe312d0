"""Servo that does not answer to small angles."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter, Values


def dead(steer: Array, q: Values) -> Array:
    """e -> 0 within w, e - w sgn(e) outside; steer (n,) rad."""
    return steer - np.clip(steer, -q["w"], q["w"])


EFFECT = Effect(
    id="steering_deadband",
    title="deadband of the steering",
    equation="e -> 0 for abs(e) < w, else e - w sgn(e)",
    source="left_out_physics",
    parameters=(
        EffectParameter("w", "rad", 0.01, 0.0, 0.15, "half width of the band, road-wheel angle", tiny=0.001),
    ),
    stage="command",
    shows="low frequency, third harmonic, no memory",
    apart="no phase lag of its own, where a backlash lags; the smaller the amplitude the larger its share",
    needs="one sweep; servo on blocks",
    excites="small amplitude",
    next_run="servo on blocks: a slow ramp up and down, angle of the wheel against command",
    act=dead,
    signed=False,
)
