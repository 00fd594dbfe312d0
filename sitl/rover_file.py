"""The vehicle file of a simulated rover, with the numbers that scales and a ruler give."""

from __future__ import annotations

from sitl.plant.variant import PlantParameters

_TEXT = """\
# The simulated rover "{name}", as if its owner had measured it. SI units.

[vehicle]
name = "simulated rover {name}"
mass = {p.mass}
sprung_mass = {p.sprung_mass}
cg_to_front_axle = {p.cg_to_front_axle}
cg_to_rear_axle = {p.cg_to_rear_axle}
cg_height_above_roll_centre = {p.cg_height_above_roll_centre}
roll_inertia = {p.roll_inertia}
yaw_inertia = {p.yaw_inertia}

[steering]
trim_us = {p.steering_trim_us}
rad_per_us = {p.rad_per_us}

[imu]
position = [{imu}]
"""


def rover_file(parameters: PlantParameters, name: str) -> str:
    """rover.toml as text, from the numbers of the plant that a user can measure."""
    safe = "".join(c for c in name if c.isprintable() and c not in '"\\\\')
    imu = ", ".join(str(x) for x in parameters.imu_position)
    return _TEXT.format(p=parameters, name=safe, imu=imu)
