"""Ground that falls to one side."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Array
from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter, Motion, Values


def downhill(motion: Motion, q: Values, mass: float) -> tuple[Array, float, Array]:
    """Weight across the rover [N], and what it does to the sprung mass above the roll axis [N m].

    The ground pushes back, which the accelerometer shows and the body leans out of.
    """
    side = q["b_cos"] * np.cos(motion["psi"]) + q["b_sin"] * np.sin(motion["psi"])
    return -mass * GRAVITY * side, 0.0, motion["ms_h"] * GRAVITY * side


def slope(found: Values) -> dict[str, tuple[float, str, str]]:
    """Slope b and the heading psi0 at which it shows most."""
    c, s = found["b_cos"], found["b_sin"]
    return {
        "b": (float(np.hypot(c, s)), "rad", "slope of the ground"),
        "psi0": (float(np.arctan2(s, c)), "rad", "heading, left positive from north, of the largest +a_y"),
    }


EFFECT = Effect(
    id="cross_slope",
    title="the ground slopes",
    equation="a_y + g b cos(psi - psi0)",
    source="left_out_physics",
    parameters=(
        EffectParameter("b_cos", "rad", 0.04, -0.4, 0.4, "b cos(psi0)", tiny=0.008),
        EffectParameter("b_sin", "rad", 0.04, -0.4, 0.4, "b sin(psi0)", tiny=0.008),
    ),
    stage="force",
    shows="means of r and a_y locked to the heading",
    apart="a tilted IMU and a trim do not turn with the heading",
    needs="headings",
    excites="runs to and fro",
    next_run="the same run in the opposite direction",
    act=downhill,
    weight=True,
    shown=slope,
    material={"b_cos": 0.02, "b_sin": 0.02},
)
