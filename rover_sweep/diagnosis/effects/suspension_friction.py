"""Dry friction in the suspension."""

from __future__ import annotations

from rover_sweep.diagnosis.effects.effect import Effect, EffectParameter, Values


def torque(found: Values) -> dict[str, tuple[float, str, str]]:
    """The torque alone: how sharply it turns over is the simulation's, and no property of the rover."""
    return {"T": (found["T"], "N m", "friction torque against the roll rate")}


EFFECT = Effect(
    id="suspension_friction",
    title="dry friction of the suspension",
    equation="T sgn p against the roll",
    source="left_out_physics",
    parameters=(
        EffectParameter("T", "N m", 0.03, 0.0, 1.5, "friction torque against the roll rate", tiny=0.002),
        EffectParameter(
            "width", "-", 0.7, -2.0, 2.0, "ln of the roll rate at which it holds, over .01 rad/s"
        ),
    ),
    stage="vehicle",
    shows="p and what follows from it; inflates b_phi",
    apart="its share falls with the amplitude; a damper's does not",
    needs="two amplitudes with p recorded",
    excites="small roll rates",
    next_run="a sweep at half the amplitude across the roll mode",
    slots={"T": "T_roll", "width": "ln_width"},
    shown=torque,
    baselines=("roll-yaw",),
    channels=("p",),
    signed=False,
)
