"""The numbers of a simulated rover, and the small TOML files (variants) that they come from."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

from sitl.plant.effects_table import Effects, checked, merged
from sitl.plant.plant_law import PlantLaw, table_laws
from sitl.plant.variant_toml import read_toml

GRAVITY = 9.80665  # m/s^2

VARIANTS = Path(__file__).parent / "variants"
_MAY_BE_NEGATIVE = {"roll_yaw_inertia", "rad_per_us"}


@dataclass(frozen=True, kw_only=True)
class PlantParameters:
    """Everything the plant and its sensors are made of, with SI units; lengths from the CG or the axle named.

    Body: cg_height_above_roll_centre of the sprung CG; yaw_inertia of the whole rover; roll_inertia of the
    sprung mass about its own CG; roll_yaw_inertia, Ixz in the sign of equation (18); roll_stiffness and
    roll_damping of the suspension.
    Tyres, per axle: cornering stiffness at zero slip; friction, peak lateral force over axle load;
    tyre_shape, see `lateral_force`.
    Steering: rad_per_us, positive when a larger PWM turns right; servo_lag, first order; servo_rate_limit of
    the wheel.
    Drive: speed_per_us without resistance; rolling_resistance of the weight; throttle_lost_us, a dead zone
    beyond which the drive begins from nothing (0 in the variants).
    Road, rms per m/s of speed: road_force, road_yaw_moment, road_roll_moment; road_length over which it
    changes.
    IMU: imu_position (forward, right, down) from the sprung CG; gyro_noise and accel_noise, one-sided;
    vibration by speed; gyro_bias, accel_bias (FRD).
    Estimator and GPS: errors are rms.
    effects: beyond all this, by id and parameter, see `effects_table.py`; mostly none. laws: see `PlantLaw`.
    """

    mass: Annotated[float, "kg"]
    sprung_mass: Annotated[float, "kg"]
    cg_to_front_axle: Annotated[float, "m"]
    cg_to_rear_axle: Annotated[float, "m"]
    cg_height_above_roll_centre: Annotated[float, "m"]
    yaw_inertia: Annotated[float, "kg m^2"]
    roll_inertia: Annotated[float, "kg m^2"]
    roll_yaw_inertia: Annotated[float, "kg m^2"]
    roll_stiffness: Annotated[float, "N m/rad"]
    roll_damping: Annotated[float, "N m s/rad"]
    front_cornering_stiffness: Annotated[float, "N/rad"]
    rear_cornering_stiffness: Annotated[float, "N/rad"]
    friction: Annotated[float, "-"]
    tyre_shape: Annotated[float, "-"]
    steering_trim_us: Annotated[float, "us"]
    rad_per_us: Annotated[float, "rad/us"]
    steering_limit: Annotated[float, "rad"]
    servo_lag: Annotated[float, "s"]
    servo_delay: Annotated[float, "s"]
    servo_rate_limit: Annotated[float, "rad/s"]
    throttle_trim_us: Annotated[float, "us"]
    throttle_deadband_us: Annotated[float, "us"]
    speed_per_us: Annotated[float, "m/s per us"]
    speed_lag: Annotated[float, "s"]
    drive_force_limit: Annotated[float, "N"]
    rolling_resistance: Annotated[float, "-"]
    road_force: Annotated[float, "N s/m"]
    road_yaw_moment: Annotated[float, "N s"]
    road_roll_moment: Annotated[float, "N s"]
    road_length: Annotated[float, "m"]
    imu_position: Annotated[tuple[float, float, float], "m"]
    gyro_noise: Annotated[float, "rad/s/sqrt(Hz)"]
    accel_noise: Annotated[float, "m/s^2/sqrt(Hz)"]
    vibration: Annotated[float, "m/s^2/sqrt(Hz) per m/s"]
    gyro_bias: Annotated[tuple[float, float, float], "rad/s"]
    accel_bias: Annotated[tuple[float, float, float], "m/s^2"]
    velocity_lag: Annotated[float, "s"]
    velocity_error: Annotated[float, "m/s"]
    attitude_error: Annotated[float, "rad"]
    error_time: Annotated[float, "s"]
    gps_interval: Annotated[float, "s"]
    gps_lag: Annotated[float, "s"]
    gps_position_error: Annotated[float, "m"]
    gps_velocity_error: Annotated[float, "m/s"]
    throttle_delay: Annotated[float, "s"] = 0.0
    throttle_lost_us: Annotated[float, "us"] = 0.0
    effects: Effects = field(default_factory=dict, hash=False)
    laws: tuple[PlantLaw, ...] = ()

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, float) and name not in _MAY_BE_NEGATIVE and value < 0:
                raise ValueError(f"{name} = {value} must not be negative")
        for name in _MUST_BE_POSITIVE:
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} = {getattr(self, name)} must be greater than 0")
        if self.sprung_mass > self.mass:
            raise ValueError(f"sprung_mass = {self.sprung_mass} kg is more than mass = {self.mass} kg")
        if not 1.0 <= self.tyre_shape < 2.0:
            raise ValueError(f"tyre_shape = {self.tyre_shape} must lie in 1..2 (1.3 is usual)")
        topple = self.sprung_mass * GRAVITY * self.cg_height_above_roll_centre
        if self.roll_stiffness <= topple:
            raise ValueError(
                f"roll_stiffness = {self.roll_stiffness} N m/rad does not hold the body upright: "
                f"it must exceed sprung_mass * g * cg_height_above_roll_centre = {topple:.3g}"
            )


_MUST_BE_POSITIVE = (
    "mass",
    "sprung_mass",
    "cg_to_front_axle",
    "cg_to_rear_axle",
    "yaw_inertia",
    "roll_inertia",
    "front_cornering_stiffness",
    "rear_cornering_stiffness",
    "friction",
    "steering_limit",
    "servo_rate_limit",
    "speed_per_us",
    "speed_lag",
    "drive_force_limit",
    "road_length",
    "error_time",
    "gps_interval",
)
_OPTIONAL = ("throttle_delay", "throttle_lost_us")
_KINDS = {f.name: f.type for f in fields(PlantParameters) if f.name not in ("effects", "laws")}


def unit_of(name: str) -> str:
    """The unit of a number of a variant file, "-" for none."""
    return str(get_args(get_type_hints(PlantParameters, include_extras=True)[name])[1])


def variant_names() -> tuple[str, ...]:
    """Names of the variants that come with the project."""
    return tuple(sorted(path.stem for path in VARIANTS.glob("*.toml")))


def load_variant(name_or_path: str | Path) -> PlantParameters:
    """The parameters of a variant: a name of `variant_names`, or the path of a TOML file.

    A file gives numbers by the field names of `PlantParameters`; with `base = "nominal"` (a name, or a
    path relative to the file) it needs only those that differ. A table `[effects]` adds physics that is not
    nominal, tables `[[table_law]]` laws without a name. Raises ValueError naming the wrong entry.
    """
    numbers = _numbers(_locate(name_or_path, Path.cwd()), ())
    missing = [name for name in _KINDS if name not in numbers and name not in _OPTIONAL]
    if missing:
        raise ValueError(f'variant {name_or_path}: missing {", ".join(missing)} (or give base = "nominal")')
    try:
        return PlantParameters(**numbers)
    except ValueError as error:
        raise ValueError(f"variant {name_or_path}: {error}") from None


def _locate(name_or_path: str | Path, directory: Path) -> Path:
    named = VARIANTS / f"{name_or_path}.toml"
    path = named if named.is_file() else directory / name_or_path
    if not path.is_file():
        raise ValueError(
            f"no variant {name_or_path}: give one of {', '.join(variant_names())} or the path of a TOML file"
        )
    return path


def _numbers(path: Path, seen: tuple[Path, ...]) -> dict[str, Any]:
    if path in seen:
        raise ValueError(f"variant {path.name}: its base refers back to itself")
    try:
        entries = read_toml(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"variant {path.name} is not a TOML file: {error}") from None
    base = entries.pop("base", None)
    if base is not None and not isinstance(base, str):
        raise ValueError(f"variant {path.name}: base = {base!r} must be the name or path of a variant")
    inherited = _numbers(_locate(base, path.parent), (*seen, path)) if base is not None else {}
    own = checked(entries.pop("effects", {}), path.name)
    effects = merged(inherited.pop("effects", {}), own)
    laws = (*inherited.pop("laws", ()), *table_laws(entries.pop("table_law", []), path.name))
    added = {**({"effects": effects} if effects else {}), **({"laws": laws} if laws else {})}
    return {**inherited, **_checked(entries, path.name), **added}


def _checked(entries: Mapping[str, Any], where: str) -> dict[str, Any]:
    unknown = [name for name in entries if name not in _KINDS]
    if unknown:
        raise ValueError(
            f"variant {where}: unknown {', '.join(unknown)}; allowed: base, {', '.join(_KINDS)}, effects"
        )
    return {
        name: _triple(value, name, where) if "tuple" in _KINDS[name] else _number(value, name, where)
        for name, value in entries.items()
    }


def _number(value: object, name: str, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not _is_finite(value):
        raise ValueError(f"variant {where}: {name} = {value!r} must be a finite number")
    return float(value)


def _is_finite(value: float) -> bool:
    return abs(value) <= sys.float_info.max  # of whole numbers of any length too; NaN is not


def _triple(value: object, name: str, where: str) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(f"variant {where}: {name} = {value!r} must be three numbers [forward, right, down]")
    return tuple(_number(part, name, where) for part in value)
