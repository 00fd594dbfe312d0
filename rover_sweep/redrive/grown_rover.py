"""The simulated rover grown to the mass and size of another: a stiffness of 31 N/rad holds 2.66 kg, not 60.

Per axle load the tyres stay as stiff; the body keeps the frequency and damping of its roll; force, noise and
roughness of the road keep their accelerations.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.vehicle_file import Vehicle
from sitl.plant.variant import PlantParameters

_SIZES = ("mass", "sprung_mass", "cg_height_above_roll_centre", "yaw_inertia", "roll_inertia")
LEAST = 1.15  # ratio of masses from which the rest is scaled


def as_measured_size(rover: PlantParameters, vehicle: Vehicle) -> dict[str, float]:
    """Mass, sprung mass, height and inertias that a vehicle file gives; those that it lacks in proportion."""
    given = {n: v.value for n in _SIZES if (v := getattr(vehicle, n)) is not None}
    mass = given.get("mass", rover.mass)
    ratio = mass / rover.mass
    wheelbase = sum(v.value for v in (vehicle.cg_to_front_axle, vehicle.cg_to_rear_axle) if v is not None)
    length = (wheelbase or _wheelbase(rover)) / _wheelbase(rover)
    own = {
        "mass": mass,
        "sprung_mass": rover.sprung_mass * ratio,
        "cg_height_above_roll_centre": rover.cg_height_above_roll_centre * length,
        "yaw_inertia": rover.yaw_inertia * ratio * length**2,
        "roll_inertia": rover.roll_inertia * ratio * length**2,
    }
    return own | given


def grown(rover: PlantParameters, size: dict[str, float]) -> PlantParameters:
    """The rover at that size, unchanged where its mass hardly differs."""
    ratio = size["mass"] / rover.mass
    if 1 / LEAST < ratio < LEAST:
        return rover
    heavy, light = _about_roll_axis(size), _about_roll_axis(vars(rover))
    weight, own = _toppling(size), _toppling(vars(rover))
    spring = (rover.roll_stiffness - own) * heavy / light + weight
    changes: dict[str, Any] = {
        **size,
        "front_cornering_stiffness": rover.front_cornering_stiffness * ratio,
        "rear_cornering_stiffness": rover.rear_cornering_stiffness * ratio,
        "roll_stiffness": spring,
        "roll_damping": rover.roll_damping * heavy / light,
        "drive_force_limit": rover.drive_force_limit * ratio,
        "road_force": rover.road_force * ratio,
        "road_yaw_moment": rover.road_yaw_moment * size["yaw_inertia"] / rover.yaw_inertia,
        "road_roll_moment": rover.road_roll_moment * heavy / light,
    }
    return replace(rover, **changes)


def _wheelbase(rover: PlantParameters) -> float:
    return rover.cg_to_front_axle + rover.cg_to_rear_axle


def _about_roll_axis(size: dict[str, Any]) -> float:
    """Roll inertia about the roll axis [kg m2]."""
    h = size["cg_height_above_roll_centre"]
    return float(size["roll_inertia"] + size["sprung_mass"] * h * h)


def _toppling(size: dict[str, Any]) -> float:
    return float(size["sprung_mass"] * GRAVITY * size["cg_height_above_roll_centre"])
