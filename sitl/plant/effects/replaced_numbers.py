"""Effects that replace a number of the plant."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from sitl.plant.effects_table import Effects, number
from sitl.plant.variant import PlantParameters

# (effect, parameter) -> number of the plant that it is
_SAME: dict[tuple[str, str], tuple[str, ...]] = {
    ("servo_lag", "T"): ("servo_lag",),
    ("servo_rate_limit", "R"): ("servo_rate_limit",),
    ("transport_delay", "T"): ("servo_delay",),
    ("tyre_saturation", "mu"): ("friction",),
    ("tyre_slip", "C"): ("front_cornering_stiffness", "rear_cornering_stiffness"),
    ("tyre_slip", "Izz"): ("yaw_inertia",),
    ("roll_dof", "k_phi"): ("roll_stiffness",),
    ("roll_dof", "b_phi"): ("roll_damping",),
    ("velocity_lag", "T"): ("velocity_lag",),
}


def resolved(parameters: PlantParameters) -> PlantParameters:
    """The parameters as the plant and its sensors have them; what the vehicle file says stays outside.

    The very same object where no effect touches a number. Harmless to apply twice, except to `imu_offset`,
    `steering_scale` and `front_rear_stiffness`, so the effects that were applied are taken out.
    """
    effects = parameters.effects
    changes: dict[str, Any] = {}
    for (effect, parameter), names in _SAME.items():
        if effect in effects:
            changes |= dict.fromkeys(names, number(effects, effect, parameter))
    if "front_rear_stiffness" in effects:
        changes |= _shared(parameters, changes, number(effects, "front_rear_stiffness", "ratio"))
    if "steering_scale" in effects:
        changes["rad_per_us"] = parameters.rad_per_us * (1.0 + number(effects, "steering_scale", "s"))
    if "imu_offset" in effects:
        forward, right, down = parameters.imu_position
        x, z = (number(effects, "imu_offset", name) for name in "xz")
        changes["imu_position"] = (forward + x, right, down - z)
    return replace(parameters, **changes, effects=_left(effects)) if changes else parameters


def _shared(parameters: PlantParameters, changes: dict[str, Any], ratio: float) -> dict[str, float]:
    """The sum of both axles' stiffness shared out in the ratio front over rear."""
    names = ("front_cornering_stiffness", "rear_cornering_stiffness")
    total = sum(changes.get(name, getattr(parameters, name)) for name in names)
    return dict(zip(names, (total * ratio / (1.0 + ratio), total / (1.0 + ratio)), strict=True))


def _left(effects: Effects) -> Effects:
    """The effects that do not replace a number; tyre_saturation and servo_lag may still select a law."""
    done = {effect for effect, _ in _SAME} | {"front_rear_stiffness", "imu_offset", "steering_scale"}
    lawful = {"tyre_saturation"} | ({"servo_lag"} if "q" in effects.get("servo_lag", {}) else set())
    return {name: values for name, values in effects.items() if name not in done - lawful}
