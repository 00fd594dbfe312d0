"""Conversion of a vehicle file to the quantities of the models, and to their standard deviations."""

from __future__ import annotations

from dataclasses import replace
from math import hypot
from typing import Any

from rover_sweep.data.geometry import Geometry, Tolerances
from rover_sweep.data.plausibility import FILE_KEYS
from rover_sweep.data.vehicle_file import Measured, Vehicle
from rover_sweep.data.vehicle_rules import HOW, MATERIAL

MODEL_NAMES = {key: name for name, key in FILE_KEYS.items()}
SIZED = {  # key of the vehicle file: key of [material]
    "cg_to_front_axle": "cg_position",
    "cg_to_rear_axle": "cg_position",
    "cg_height_above_roll_centre": "cg_height_share",
    "roll_inertia": "roll_inertia_share",
    "rad_per_us": "steering_scale",
}
AXLES = ("cg_to_front_axle", "cg_to_rear_axle")
USUAL = {  # standard deviation over the value, if the file does not say how it was measured
    "mass": HOW["scale"],
    "sprung_mass": HOW["scale"],
    "cg_height_above_roll_centre": HOW["guess"],  # nobody sees the roll axis
    "roll_inertia": 0.15,
    "yaw_inertia": HOW["swing"],
    "friction": HOW["guess"],
    "rad_per_us": HOW["bench"],
}
LEAST_IMU = 0.005  # m, least default standard deviation of the IMU's place
EXACT = 1e-3  # least standard deviation of a prior, over the value or the wheelbase


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


def with_uncertainties(vehicle: Vehicle) -> Vehicle:
    """The vehicle with a standard deviation for each number that has a rule; its `how` names the source.

    The file's `sd` or `how` comes first, then [material], then the default, which scales with the vehicle.
    """
    found: dict[str, Any] = {}
    for name in (*AXLES, *USUAL):
        number: Measured | None = getattr(vehicle, name)
        if number is None or number.sd is not None:
            continue
        size, of = vehicle.material.get(SIZED.get(name, "")), abs(number.value)
        if size is not None:
            of = 1.0 if MATERIAL[SIZED[name]].unit == "m" else of
            found[name] = replace(number, sd=0.5 * size * of, how="[material]")
        elif name in AXLES:
            found[name] = replace(number, sd=HOW["ruler"] * vehicle.wheelbase, how="default")
        elif number.value:
            found[name] = replace(number, sd=USUAL[name] * of, how="default")
    if vehicle.imu_position is not None:
        x, y, z = (_place(number, vehicle) for number in vehicle.imu_position)
        found["imu_position"] = x, y, z
    return replace(vehicle, **found)


def _place(number: Measured, vehicle: Vehicle) -> Measured:
    """A coordinate of the IMU with its standard deviation."""
    if number.sd is not None:
        return number
    if (size := vehicle.material.get("imu_position")) is not None:
        return replace(number, sd=0.5 * size, how="[material]")
    return replace(number, sd=max(HOW["ruler"] * vehicle.wheelbase, LEAST_IMU), how="default")


def tolerances_of(vehicle: Vehicle) -> Tolerances:
    """Tolerances for diagnosis and plan: the standard deviations of the numbers, and [material].

    The better known of a and b locates the CG. The height of the IMU above the roll axis is as uncertain as
    its place from the CG and h together, unless [material] gives it.
    """
    full = with_uncertainties(vehicle)
    found = {MATERIAL[k].field: size / MATERIAL[k].deviations for k, size in vehicle.material.items()}
    for name, key in SIZED.items():
        number: Measured | None = getattr(full, name)
        if name not in AXLES and number is not None and number.sd is not None and number.value:
            found[MATERIAL[key].field] = _share(number.sd, abs(number.value), key)
    axles = (full.cg_to_front_axle, full.cg_to_rear_axle)
    written = [n for n in axles if n.how not in ("default", "[material]")] or axles
    cg = min(n.sd or 0.0 for n in written)
    forward, _, down = full.imu_position or (_place(Measured(0.0), vehicle),) * 3
    h = full.cg_height_above_roll_centre
    axis = h.sd if h is not None and h.sd is not None and down.how != "[material]" else 0.0
    for name, sd, key in (
        ("cg", cg, "cg_position"),
        ("imu_x", forward.sd or 0.0, "imu_position"),
        ("imu_z", hypot(down.sd or 0.0, axis), "imu_position"),
    ):
        found[name] = _share(sd, vehicle.wheelbase, key)
    return replace(Tolerances(), **found)


def _share(sd: float, of: float, key: str) -> float:
    """sd over `of`, at most what [material] allows, and never 0, which no fit can use as a prior."""
    most = MATERIAL[key].most / MATERIAL[key].deviations
    return max(min(sd / of, most / of if MATERIAL[key].unit == "m" else most), EXACT)
