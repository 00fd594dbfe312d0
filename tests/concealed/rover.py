"""The rover of a set and what its vehicle file gets wrong: drawn anew for every set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

GRAVITY = 9.81
Rng = np.random.Generator


@dataclass(frozen=True)
class Rover:
    """True numbers of a simulated rover, SI.

    m, ms [kg]; a, b [m]; h [m] sprung CG above the roll axis; izz, ixx [kg m^2] (ixx of the sprung mass
    about its own CG); k_phi [N m/rad], b_phi [N m s/rad]; cf, cr [N/rad] per axle; rad_per_us [rad/us];
    imu_x [m] ahead of the CG, imu_z [m] above the roll axis; friction: where the tyres give way when no
    effect is concealed (peak side force over load, of the law in `motion`).
    """

    m: float
    ms: float
    a: float
    b: float
    h: float
    izz: float
    ixx: float
    k_phi: float
    b_phi: float
    cf: float
    cr: float
    rad_per_us: float
    imu_x: float
    imu_z: float
    friction: float

    def critical_speed(self) -> float:
        """Speed at which the linear rover becomes unstable, m/s; inf for one that understeers."""
        understeer = self.m * (self.b * self.cr - self.a * self.cf)
        return (
            float(np.sqrt(-self.cf * self.cr * (self.a + self.b) ** 2 / understeer))
            if understeer < 0
            else np.inf
        )


@dataclass(frozen=True)
class Nuisance:
    """The small mismatches every set has; SI.

    servo_lag [s], delay [s] (from the main loop on that put the pulse out); trim [rad] of the road wheel;
    gyro_lag, accel_lag, ekf_lag [s] first order; speed_scale -; ay_bias [m/s^2], gyro_bias [rad/s] (x, z);
    heading_error [rad]; file_*: what the vehicle file says relative to the truth.
    """

    servo_lag: float
    delay: float
    trim: float
    gyro_lag: float
    accel_lag: float
    ekf_lag: float
    speed_scale: float
    ay_bias: float
    gyro_bias: tuple[float, float]
    heading_error: float
    file_cg: float
    file_h: float
    file_ixx: float
    file_izz: float
    file_mass: float
    file_steering: float


def draw_rover(rng: Rng) -> Rover:
    """A sensible rover between 1:10 and 1:5; stable up to well above the speeds driven."""
    while True:
        rover = _any_rover(rng)
        if rover.critical_speed() > 1.8 * cruise_speed(rover, 1.15):
            return rover


def _any_rover(rng: Rng) -> Rover:
    base = float(np.exp(rng.uniform(np.log(0.27), np.log(0.52))))
    m = 2.66 * (base / 0.39) ** 2.4 * rng.uniform(0.85, 1.2)
    ms = m * rng.uniform(0.86, 0.92)
    a = base * rng.uniform(0.46, 0.54)
    h = base * rng.uniform(0.12, 0.18)
    ixx = ms * (base * rng.uniform(0.165, 0.205)) ** 2
    stiffness = m * GRAVITY / 2 * rng.uniform(2.2, 3.8)
    uneven = rng.uniform(-0.06, 0.06)
    w_roll = rng.uniform(14.0, 23.0) * np.sqrt(0.39 / base)
    about_axis = ixx + ms * h * h
    return Rover(
        m=m,
        ms=ms,
        a=a,
        b=base - a,
        h=h,
        izz=m * base**2 * rng.uniform(0.15, 0.2),
        ixx=ixx,
        k_phi=about_axis * w_roll**2 + ms * GRAVITY * h,
        b_phi=2 * rng.uniform(0.25, 0.5) * w_roll * about_axis,
        cf=stiffness * (1 + uneven),
        cr=stiffness * (1 - uneven),
        rad_per_us=rng.uniform(0.0008, 0.0011),
        imu_x=rng.uniform(-0.12, 0.12) * base,
        imu_z=h + rng.uniform(-0.1, 0.1) * base,
        friction=rng.uniform(1.05, 1.25),
    )


def cruise_speed(rover: Rover, factor: float) -> float:
    """Main speed of the plan, m/s: 2.5 m/s for the wheelbase of 0.39 m, by Froude number otherwise."""
    return 2.5 * float(np.sqrt((rover.a + rover.b) / 0.39)) * factor


def _normal(rng: Rng, sd: float, limit: float) -> float:
    return float(np.clip(rng.normal(0.0, sd), -limit, limit))


def draw_nuisance(rng: Rng) -> Nuisance:
    """Lag and delay within 40 ms each and 70 ms together, CG 10 mm, h 10 %, Ixx 15 %, steering 3 %."""
    lag, delay = rng.uniform(0.010, 0.040), rng.uniform(0.008, 0.040)
    shrink = min(1.0, 0.068 / (lag + delay))
    return Nuisance(
        servo_lag=lag * shrink,
        delay=delay * shrink,
        trim=_normal(rng, 0.002, 0.005),
        gyro_lag=rng.uniform(0.0, 0.003),
        accel_lag=rng.uniform(0.0, 0.003),
        ekf_lag=rng.uniform(0.0, 0.003),
        speed_scale=1 + _normal(rng, 0.0075, 0.015),
        ay_bias=_normal(rng, 0.12, 0.3),
        gyro_bias=(_normal(rng, 0.002, 0.005), _normal(rng, 0.002, 0.005)),
        heading_error=_normal(rng, 0.01, 0.025),
        file_cg=_normal(rng, 0.006, 0.010),
        file_h=1 + _normal(rng, 0.06, 0.10),
        file_ixx=1 + _normal(rng, 0.09, 0.15),
        file_izz=1 + _normal(rng, 0.06, 0.12),
        file_mass=1 + _normal(rng, 0.004, 0.01),
        file_steering=1 + _normal(rng, 0.018, 0.03),
    )


def vehicle_file(rover: Rover, off: Nuisance, imu_offset: tuple[float, float]) -> str:
    """rover.toml as a careful owner would write it; imu_offset (x, z) m is what he does not know of."""
    h = rover.h * off.file_h
    forward = rover.imu_x - imu_offset[0] + off.file_cg
    down = h - (rover.imu_z - imu_offset[1])
    k, izz = rover.rad_per_us * off.file_steering, rover.izz * off.file_izz
    m, ms = rover.m * off.file_mass, rover.ms * off.file_mass
    return f"""[vehicle]
name = "rover"
mass = {{ value = {m:.3f}, sd = {0.005 * m:.3f} }}
cg_to_front_axle = {{ value = {rover.a + off.file_cg:.4f}, sd = 0.006 }}
cg_to_rear_axle = {{ value = {rover.b - off.file_cg:.4f}, sd = 0.006 }}
sprung_mass = {ms:.3f}
cg_height_above_roll_centre = {{ value = {h:.4f}, sd = {0.08 * h:.4f} }}
roll_inertia = {{ value = {rover.ixx * off.file_ixx:.5f}, sd = {0.12 * rover.ixx:.5f} }}
yaw_inertia = {{ value = {izz:.4f}, sd = {0.08 * izz:.4f} }}
friction = 0.9

[steering]
trim_us = 1500
rad_per_us = {{ value = {k:.6f}, sd = {0.02 * k:.6f} }}

[imu]
position = [{forward:.4f}, 0.0, {down:.4f}]
"""
