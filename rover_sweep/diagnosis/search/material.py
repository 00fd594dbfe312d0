"""The material size of an effect: smaller is within the tolerances of the vehicle file."""

from __future__ import annotations

from collections.abc import Mapping

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.effects import Effect, EffectParameter
from rover_sweep.diagnosis.simulation.candidates import Model, added_coordinates

LAGS = ("servo_lag", "transport_delay")
SWINGING = "servo_lag/second order"
MOST_SHAPE = 1.0  # of a servo that swings no more than usual, a damping ratio of 0.5
SHORTEST = 0.008  # s, of a lag whose swinging is within the band of a sweep
IMPLAUSIBLE = 0.8  # share of an effect's bound, beyond which its size is no answer
EARLIER = 0.008  # s by which the motion must precede its command, for a clock offset to be the reason


def material_sizes(effect: Effect, spread: Tolerances, wheelbase: float) -> dict[str, float]:
    """{parameter: coordinate to exceed}: the effect's own material size, or a tolerance of the rover.

    wheelbase: of the rover, m.
    """
    moved: Mapping[str, Mapping[str, float]] = {
        "front_rear_stiffness": {"ratio": spread.ratio},
        "imu_offset": {"x": 2.0 * spread.imu_x * wheelbase, "z": 2.0 * spread.imu_z * wheelbase},
        "imu_tilt": {"roll": spread.bias_ay / GRAVITY},
        "steering_trim": {"u0": spread.trim},
        "velocity_lag": {"T": spread.velocity_lag},
    }
    return {
        name: size for name, size in {**effect.thresholds, **moved.get(effect.id, {})}.items() if size > 0
    }


def least_size(effect: Effect, parameter: EffectParameter, model: Model, x: Mapping[str, float]) -> float:
    """The coordinate of a parameter, without sign, from which its effect matters; 0 where every size does.

    x: {coordinate: value}. Lag and delay matter only where both together are above the normal tolerance.
    """
    if effect.id in LAGS:
        return model.spread.together - x["delay" if effect.id == "servo_lag" else "lag"]
    if effect.id == "clock_offset" and not model.two_clocks:
        return EARLIER
    return material_sizes(effect, model.spread, model.rover.wheelbase).get(parameter.name, 0.0)


def exceeds_material_size(
    effect: Effect, x: Mapping[str, float], spread: Tolerances, wheelbase: float
) -> bool:
    """True where any parameter of the effect at the coordinates x exceeds its material size."""
    return effect.exceeds(x, material_sizes(effect, spread, wheelbase))


def is_material(effect: str, model: Model, x: Mapping[str, float]) -> bool:
    """False where an effect of a fitted model is below its material size, or implausibly near its bound.

    effect: its id. x: {coordinate: value}.
    """
    law = next(f for f in map(model.law, model.effects) if f.id == effect)
    limits = {c.name: max(abs(c.low), abs(c.high)) for c in added_coordinates(law)}
    if any(abs(x[name]) > IMPLAUSIBLE * limit for name, limit in limits.items() if not name.endswith(".t")):
        return False
    if law.name == SWINGING and x["lag_shape"] > MOST_SHAPE and x["lag"] > SHORTEST:
        return True
    if effect in LAGS:
        return x["lag"] + x["delay"] > model.spread.together
    if effect == "clock_offset" and not model.two_clocks:
        return x["delay"] < -EARLIER
    return exceeds_material_size(law, x, model.spread, model.rover.wheelbase)
