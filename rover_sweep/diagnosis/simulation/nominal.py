"""The nominal model of a baseline: its coordinates with their bounds and priors.

Normal tolerances of every rover are coordinates of the nominal model: a lag and a delay up to 40 ms, Cf and
Cr within 15 %, a steering scale within 3 % and others. The tolerance is the bound or the prior, so that it is
never a finding. Positive physical numbers have logarithmic coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, log, pi

from rover_sweep.data.geometry import GRAVITY, Geometry
from rover_sweep.data.tolerances import Tolerances


@dataclass(frozen=True)
class Coordinate:
    """A number that the fit moves.

    low, high: bounds. scale: typical change. prior: standard deviation about `start`, None for no prior.
    unit: of the physical parameter.
    """

    name: str
    start: float
    low: float
    high: float
    scale: float
    prior: float | None = None
    parameter: str = ""
    """Physical parameter of a logarithmic coordinate, else ""."""
    unit: str = ""
    step: float = 0.02
    """Step of the difference quotients, in scales; 0 for a coordinate that a fit does not move."""


def coordinates(
    baseline: str, rover: Geometry, spread: Tolerances, slip: bool, roll: bool
) -> tuple[Coordinate, ...]:
    """The coordinates of a baseline ("kinematic", "bicycle", "roll-yaw").

    spread: normal tolerances. slip, roll: True if the model has them, by the baseline or by an effect.
    """
    s, length = spread, rover.wheelbase
    cg, imu_x, imu_z = s.cg * length, s.imu_x * length, s.imu_z * length
    out = [
        Coordinate("lag", 0.02, 0.0, s.lag, 0.01),
        Coordinate("lag_shape", 0.1, 0.0, 0.5, 0.1, 0.2),  # first order to a damping of .71
        Coordinate("delay", 0.015, -s.early, s.delay, 0.01),
        Coordinate("scale", 0.0, -3 * s.scale, 3 * s.scale, 0.02, s.scale),
        Coordinate("vscale", 0.0, -3 * s.speed, 3 * s.speed, 0.02, s.speed),
        Coordinate("trim", 0.0, -s.trim, s.trim, 0.005),
        Coordinate("bias_ay", 0.0, -s.bias_ay, s.bias_ay, 0.1),
        Coordinate("imu_x", 0.0, -3 * imu_x, 3 * imu_x, 0.01, imu_x),
        Coordinate("imu_z", 0.0, -3 * imu_z, 3 * imu_z, 0.01, imu_z),
        Coordinate("ay_lag", 0.0, -3 * s.sensor_lag, 3 * s.sensor_lag, 0.005, s.sensor_lag),
        Coordinate("p_lag", 0.0, -s.sensor_lag, s.sensor_lag, 0.005, s.sensor_lag / 3),
        Coordinate("vy_lag", 0.003, 0.0, s.velocity_lag, 0.02),
        Coordinate("heading", 0.0, -3 * s.heading, 3 * s.heading, 0.01, s.heading),
        Coordinate("vy_gain", 0.0, -3 * s.velocity_gain, 3 * s.velocity_gain, 0.05, s.velocity_gain),
    ]
    if slip:
        stiffness = 3.0 * rover.mass * GRAVITY / 2
        inertia = rover.yaw_inertia or rover.mass * rover.a * rover.b
        wide = (0.4 * rover.wheelbase) ** 2  # half the track of most rovers
        out += [
            _log("C", stiffness, "N/rad"),
            _log("Izz", inertia, "kg m^2"),
            Coordinate("ln_ratio", 0.0, -s.ratio, s.ratio, 0.1),
            Coordinate("bend", s.bend, 0.0, 2 * s.bend, 0.3, 0.6 * s.bend),
            Coordinate("track", 0.0, 0.0, 3 * wide, 0.5 * wide, wide),
            Coordinate("da", 0.0, -3 * cg, 3 * cg, 0.01, cg),
        ]
    elif baseline == "kinematic":
        out.append(_log("L_eff", rover.wheelbase, "m"))
    if roll and rover.sprung_mass and rover.h and rover.roll_inertia:
        about = rover.roll_inertia + rover.sprung_mass * rover.h**2
        spring = about * (2 * pi * 3.5) ** 2
        out += [
            _log("k_phi", spring + rover.sprung_mass * GRAVITY * rover.h, "N m/rad"),
            _log("b_phi", 0.4 * about * 2 * pi * 3.5, "N m s/rad"),
            Coordinate("ln_h", 0.0, -3 * s.h, 3 * s.h, 0.05, s.h),
            Coordinate("ln_Ixx", 0.0, -3 * s.roll_inertia, 3 * s.roll_inertia, 0.1, s.roll_inertia),
        ]
    return tuple(out)


def physical_numbers(x: Mapping[str, float], rover: Geometry) -> dict[str, float]:
    """{name as in `implausible`: SI value} of the coordinates of a fitted model."""
    out = {name: exp(x[f"ln_{name}"]) for name in ("Izz", "k_phi") if f"ln_{name}" in x}
    if "ln_C" in x:
        half = 0.5 * x.get("ln_ratio", 0.0)
        out |= {"Cf": exp(x["ln_C"] + half), "Cr": exp(x["ln_C"] - half)}
    if rover.roll_inertia and "ln_Ixx" in x:
        out["Ixx"] = rover.roll_inertia * exp(x["ln_Ixx"])
    if rover.h and "ln_h" in x:
        out["h"] = rover.h * exp(x["ln_h"])
    return out | {"steering_scale": 1.0 + x.get("scale", 0.0)}


def _log(name: str, start: float, unit: str) -> Coordinate:
    value = log(start)
    return Coordinate(f"ln_{name}", value, value - 3.0, value + 3.0, 0.1, None, name, unit)
