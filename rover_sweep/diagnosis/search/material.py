"""The material size of an effect: smaller is within the tolerances of the vehicle file."""

from __future__ import annotations

from collections.abc import Mapping

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.tolerances import Tolerances
from rover_sweep.diagnosis.effects import Effect

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


def exceeds_material_size(
    effect: Effect, x: Mapping[str, float], spread: Tolerances, wheelbase: float
) -> bool:
    """True where any parameter of the effect at the coordinates x exceeds its material size."""
    return effect.exceeds(x, material_sizes(effect, spread, wheelbase))
