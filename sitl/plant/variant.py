"""The numbers of a simulated rover, and the small TOML files (variants) that they come from."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from sitl.plant.effects_table import Effects, checked, merged
from sitl.plant.plant_law import PlantLaw, table_laws
from sitl.plant.variant_toml import read_toml

GRAVITY = 9.80665  # m/s^2

VARIANTS = Path(__file__).parent / "variants"
_MAY_BE_NEGATIVE = {"roll_yaw_inertia", "rad_per_us"}


@dataclass(frozen=True, kw_only=True)
class PlantParameters:
    """Everything the plant and its sensors are made of. SI units; lengths from the CG or the axle named.

    Body: mass, sprung_mass [kg]; cg_to_front_axle, cg_to_rear_axle [m]; cg_height_above_roll_centre [m]
    of the sprung CG; yaw_inertia [kg m2] of the whole rover; roll_inertia [kg m2] of the sprung mass about
    its own CG; roll_yaw_inertia [kg m2], Ixz in the sign of equation (18); roll_stiffness [N m/rad] and
    roll_damping [N m s/rad] of the suspension.
    Tyres, per axle: front_cornering_stiffness, rear_cornering_stiffness [N/rad] at zero slip; friction [-]
    peak lateral force over axle load; tyre_shape [-], see `lateral_force`.
    Steering: steering_trim_us [us]; rad_per_us [rad/us], positive when a larger PWM turns right;
    steering_limit [rad]; servo_lag [s] first order; servo_delay [s]; servo_rate_limit [rad/s] of the wheel.
    Drive: throttle_trim_us, throttle_deadband_us [us]; speed_per_us [m/s/us] without resistance;
    speed_lag [s]; drive_force_limit [N]; rolling_resistance [-] of the weight; throttle_delay [s];
    throttle_lost_us [us], a dead zone beyond which the drive begins from nothing (0 in the variants).
    Road, rms per m/s of speed: road_force [N s/m], road_yaw_moment, road_roll_moment [N s];
    road_length [m] over which it changes.
    IMU: imu_position (forward, right, down) [m] from the sprung CG; gyro_noise [rad/s/sqrt(Hz)] and
    accel_noise [m/s2/sqrt(Hz)], one-sided; vibration [m/s2/sqrt(Hz) per m/s of speed];
    gyro_bias (FRD) [rad/s], accel_bias (FRD) [m/s2].
    Estimator: velocity_lag [s], velocity_error [m/s rms], attitude_error [rad rms], error_time [s].
    GPS: gps_interval, gps_lag [s]; gps_position_error [m rms], gps_velocity_error [m/s rms].
    effects: beyond all this, by id and parameter, see `effects_table.py`; mostly none. laws: see `PlantLaw`.
    """

    mass: float
    sprung_mass: float
    cg_to_front_axle: float
    cg_to_rear_axle: float
    cg_height_above_roll_centre: float
    yaw_inertia: float
    roll_inertia: float
    roll_yaw_inertia: float
    roll_stiffness: float
    roll_damping: float
    front_cornering_stiffness: float
    rear_cornering_stiffness: float
    friction: float
    tyre_shape: float
    steering_trim_us: float
    rad_per_us: float
    steering_limit: float
    servo_lag: float
    servo_delay: float
    servo_rate_limit: float
    throttle_trim_us: float
    throttle_deadband_us: float
    speed_per_us: float
    speed_lag: float
    drive_force_limit: float
    rolling_resistance: float
    road_force: float
    road_yaw_moment: float
    road_roll_moment: float
    road_length: float
    imu_position: tuple[float, float, float]
    gyro_noise: float
    accel_noise: float
    vibration: float
    gyro_bias: tuple[float, float, float]
    accel_bias: tuple[float, float, float]
    velocity_lag: float
    velocity_error: float
    attitude_error: float
    error_time: float
    gps_interval: float
    gps_lag: float
    gps_position_error: float
    gps_velocity_error: float
    throttle_delay: float = 0.0
    throttle_lost_us: float = 0.0
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
        name: _triple(value, name, where) if _KINDS[name] != "float" else _number(value, name, where)
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
