"""Conversion of a vehicle file to the quantities of the models."""

from __future__ import annotations

from typing import Any

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.vehicle_file import Vehicle

MODEL_NAMES = {
    "roll_inertia": "Ixx",
    "roll_yaw_inertia": "Ixz",
    "cg_height_above_roll_centre": "h",
    "sprung_mass": "ms",
    "mass": "m",
    "cg_to_front_axle": "a",
    "cg_to_rear_axle": "b",
    "yaw_inertia": "Izz",
}


def geometry_of(vehicle: Vehicle) -> Geometry:
    """The quantities of the models, in SI units and ISO axes, from a vehicle file."""

    def value(number: Any) -> float | None:
        return None if number is None else float(number.value)

    forward, _, up = vehicle.imu_iso
    h = value(vehicle.cg_height_above_roll_centre)
    return Geometry(
        mass=vehicle.mass.value,
        a=vehicle.cg_to_front_axle.value,
        b=vehicle.cg_to_rear_axle.value,
        sprung_mass=value(vehicle.sprung_mass),
        h=h,
        roll_inertia=value(vehicle.roll_inertia),
        yaw_inertia=value(vehicle.yaw_inertia),
        imu_x=forward,
        imu_z=(h or 0.0) + up,
        free=tuple(MODEL_NAMES[name] for name in vehicle.free),
        roll_yaw_inertia=value(vehicle.roll_yaw_inertia) or 0.0,
        friction=value(vehicle.friction),
    )
