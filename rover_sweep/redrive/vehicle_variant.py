"""The simulated rover: a variant of the plant with the measured numbers of a vehicle file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rover_sweep.data.recording import Recording
from rover_sweep.data.vehicle_file import Vehicle, load
from rover_sweep.errors import UsageError
from sitl.plant.plant import Plant
from sitl.plant.variant import PlantParameters, load_variant

_MEASURED = (
    "mass",
    "sprung_mass",
    "cg_to_front_axle",
    "cg_to_rear_axle",
    "cg_height_above_roll_centre",
    "yaw_inertia",
    "roll_inertia",
    "roll_yaw_inertia",
    "friction",
)


def simulated_rover(variant: str, rover_file: str | None) -> PlantParameters:
    """The parameters to simulate. UsageError if the variant or the vehicle file cannot be used."""
    try:
        parameters = load_variant(_path(variant))
        parameters = parameters if rover_file is None else as_measured(parameters, load(rover_file))
        Plant(parameters)  # raises for numbers that are valid one by one but not together
        return parameters
    except ValueError as error:
        raise UsageError(str(error)) from error


def described(parameters: PlantParameters, variant: str, rover_file: str | None) -> str:
    """One line with the numbers, their origin and the effects."""
    effects = ", ".join(
        f"{name} ({', '.join(f'{p} {v}' for p, v in values.items())})"
        for name, values in parameters.effects.items()
    )
    origin = f"variant {variant}" + (f", masses and lengths of {rover_file}" if rover_file else "")
    return (
        f"{origin}: m {parameters.mass:g} kg, a {parameters.cg_to_front_axle:g} m, "
        f"b {parameters.cg_to_rear_axle:g} m, Izz {parameters.yaw_inertia:g} kg m², "
        f"Cf {parameters.front_cornering_stiffness:g} N/rad, Cr {parameters.rear_cornering_stiffness:g} N/rad"
        + (f"; effects: {effects}" if effects else "; no effects")
    )


def on_the_clock(parameters: PlantParameters, runs: Sequence[Recording]) -> PlantParameters:
    """The parameters with the instant of a `surface_change` on the clock of the log [s].

    The effect gives it from the start of a run: the run that it names, else the first. If the log does not
    have that run, the change is left out and the surface stays as before.
    """
    change = parameters.effects.get("surface_change", {})
    if "t" not in change:
        return parameters
    effects = {name: values for name, values in parameters.effects.items() if name != "surface_change"}
    meant = [run for run in runs if change.get("run", run.name) == run.name]
    if meant:
        effects["surface_change"] = {**change, "t": float(change["t"]) + meant[0].span[0]}
    return replace(parameters, effects=effects)


def refuse_instant(parameters: PlantParameters, simulator: str) -> None:
    """UsageError for a `surface_change` at a time, since the clock of this vehicle is not that of the log."""
    if "t" in parameters.effects.get("surface_change", {}):
        raise UsageError(
            f"surface_change at a time cannot be placed on the clock of --vehicle {simulator}; give its "
            "distance [m] instead of t, or use --vehicle plant"
        )


def _path(variant: str) -> str | Path:
    """A file is used instead of a variant of the same name only if the name ends in .toml."""
    return Path(variant).resolve() if variant.endswith(".toml") and Path(variant).is_file() else variant


def as_measured(parameters: PlantParameters, vehicle: Vehicle) -> PlantParameters:
    """The parameters with the measured numbers of a vehicle file."""
    changes: dict[str, Any] = {
        name: number.value for name in _MEASURED if (number := getattr(vehicle, name)) is not None
    }
    if vehicle.trim_us is not None and vehicle.rad_per_us is not None:
        changes |= {"steering_trim_us": vehicle.trim_us.value, "rad_per_us": vehicle.rad_per_us.value}
    if vehicle.imu_position is not None:
        changes["imu_position"] = tuple(number.value for number in vehicle.imu_position)
    return replace(parameters, **changes)
