"""The course of a recorded drive, to be driven again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rover_sweep.data.geometry import GRAVITY
from rover_sweep.data.recording import Array, Recording, Signal
from rover_sweep.data.vehicle_file import Vehicle, load
from rover_sweep.errors import DataRefused, UsageError
from rover_sweep.logs.log import Log
from sitl.plant.plant import Plant
from sitl.plant.variant import PlantParameters, load_variant
from sitl.redrive.course import AppletState, Course

SMOOTHING_S = 0.3  # of the estimated speed, to remove its noise
LONGEST_GAP = 5  # loops without a record; longer gaps are filled
SLOWEST_HZ, FASTEST_HZ = 20.0, 400.0


def course_of(log: Log) -> Course:
    """The drive in a log. DataRefused if steering, gyro or speed are missing or hardly overlap."""
    for name, what in (("r", "gyro"), ("speed", "speed")):
        if name not in log.signals or log.signals[name].t.size < 2:
            raise DataRefused(f"{log.name}: no {what} was recorded, which a redrive needs")
    pwm = next((s for s in log.steering if s.unit == "us" and s.t.size > 1), None)
    if pwm is None:
        raise DataRefused(
            f"{log.name}: no steering output in us was recorded; log SWEP, RCOU or SERVO_OUTPUT_RAW"
        )
    t = _loops(log, pwm)
    if t.size < 100:
        raise DataRefused(
            f"{log.name}: too short: only {t.size} main loops have steering, gyro and speed; 100 are needed"
        )
    psi, steering = log.signals.get("psi"), _staircase(pwm, t)
    return Course(
        t=t,
        steering=steering,
        asked_t=pwm.t if pwm.hold else t,
        asked=pwm.x if pwm.hold else steering,
        speed=_smooth(np.interp(t, log.signals["speed"].t, log.signals["speed"].x), t),
        heading=float(np.interp(t[0], psi.t, psi.x)) if psi is not None else 0.0,
        applet=_applet(log, pwm, t),
        marks=tuple((at, text) for at, text in log.marks if t[0] <= at <= t[-1]),
        parameters={"INS_GYRO_FILTER": _cutoff(log, "r"), "INS_ACCEL_FILTER": _cutoff(log, "ay")}
        | dict(log.parameters),
    )


def _loops(log: Log, pwm: Signal) -> Array:
    """Times (n,) s of the main loops in which steering, gyro and speed are recorded.

    The time stamps of the gyro with gaps filled, or every 10 ms if raw gyro samples were logged.
    """
    gyro, speed = log.signals["r"], log.signals["speed"]
    start = max(pwm.t[0], gyro.t[0], speed.t[0])
    end = min(pwm.t[-1], gyro.t[-1], speed.t[-1])
    if end <= start:
        return np.empty(0)
    if not SLOWEST_HZ <= gyro.rate <= FASTEST_HZ:
        return np.arange(start, end, 0.01)
    t = gyro.t[(gyro.t >= start) & (gyro.t <= end)]
    period = 1.0 / gyro.rate
    gaps = np.flatnonzero(np.diff(t) > LONGEST_GAP * period)
    filled = [np.arange(t[k] + period, t[k + 1] - 0.5 * period, period) for k in gaps]
    return np.sort(np.concatenate((t, *filled)))


def _staircase(pwm: Signal, t: Array) -> Array:
    """PWM (n,) us on the servo from each loop on.

    A held output reaches the servo at the next loop. A continuous one is sampled at the middle of the loop.
    """
    if pwm.hold:
        k = np.searchsorted(pwm.t, t, "right") - 1
        return pwm.x[np.clip(k, 0, pwm.t.size - 1)].astype(float)
    return np.interp(t + 0.5 * float(np.median(np.diff(t))), pwm.t, pwm.x)


def _smooth(x: Array, t: Array) -> Array:
    width = max(1, round(SMOOTHING_S / float(np.median(np.diff(t)))) | 1)
    padded = np.pad(x, width // 2, mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def _applet(log: Log, pwm: Signal, t: Array) -> AppletState | None:
    if log.applet is None or not pwm.hold:
        return None
    rows = log.applet
    inside = (rows.t >= t[0]) & (rows.t <= t[-1])
    at = rows.t[inside]
    out = pwm.x[np.clip(np.searchsorted(pwm.t, at, "right") - 1, 0, pwm.t.size - 1)]
    return AppletState(at, rows.run[inside], rows.state[inside], rows.clock[inside], out)


def _cutoff(log: Log, channel: str) -> float:
    """Cut-off of the known low-pass of a channel [Hz], 0 if it has none."""
    return log.filters[channel].cutoff_hz if channel in log.filters else 0.0


# The simulated rover grown to the mass and size of another: a stiffness of 31 N/rad holds 2.66 kg, not 60.
#
# Per axle load the tyres stay as stiff; the body keeps the frequency and damping of its roll; force, noise
# and roughness of the road keep their accelerations.


_SIZES = ("mass", "sprung_mass", "cg_height_above_roll_centre", "yaw_inertia", "roll_inertia")
LEAST = 1.15  # ratio of masses from which the rest is scaled


def as_measured_size(rover: PlantParameters, vehicle: Vehicle) -> dict[str, float]:
    """Mass, sprung mass, height and inertias of a vehicle file; missing ones are scaled."""
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
    """The rover at that size, unchanged if its mass hardly differs."""
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


# The simulated rover: a variant of the plant with the measured numbers of a vehicle file.


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
            f"surface_change at a time cannot be placed on the clock of --simulator {simulator}; give its "
            "distance [m] instead of t, or use --simulator plant"
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
