"""What the autopilot makes of the motion: filtered IMU, EKF velocity and attitude; still in ISO axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import bilinear, lfilter

from tests.concealed.effects import Hidden, part
from tests.concealed.motion import STEP
from tests.concealed.rover import GRAVITY, Nuisance, Rng, Rover
from tests.concealed.run import Motion, Roughness, coloured

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Measured:
    """At 1 kHz: t (n,) s; gyro, accel (n, 3); velocity, position (n, 2) north, west; phi, psi (n,) rad."""

    t: Array
    gyro: Array
    accel: Array
    velocity: Array
    position: Array
    phi: Array
    psi: Array


def low_pass(x: Array, hz: float) -> Array:
    """Second-order Butterworth low-pass at the 1 kHz sample rate; inf leaves x alone."""
    if not np.isfinite(hz):
        return x
    w = 2 / STEP * np.tan(np.pi * hz * STEP)  # prewarped, as the firmware's filter
    b, a = bilinear([w * w], [1.0, np.sqrt(2.0) * w, w * w], 1 / STEP)
    return _from_rest(b, a, x)


def lag(x: Array, seconds: float) -> Array:
    """First-order lag; 0 leaves x alone."""
    if seconds <= 0:
        return x
    keep = np.exp(-STEP / seconds)
    return _from_rest(np.array([1 - keep]), np.array([1.0, -keep]), x)


def _from_rest(b: Array, a: Array, x: Array) -> Array:
    """Filtered along the first axis, as if x had always been x[0]."""
    return lfilter(b, a, x - x[0], axis=0) + x[0]


def kinematics(
    motion: Motion, x_imu: float, z_imu: float, slope: float, slope_heading: float
) -> tuple[Array, Array, Array]:
    """Body rates (n, 3), specific force (n, 3) in body axes, and velocity (n, 2) in road axes at the IMU."""
    vy, r, phi, p, v, psi = (motion[k] for k in range(6))
    dvy, dr, ddphi, dv = motion[12], motion[13], motion[15], motion[16]
    s, c = np.sin(phi), np.cos(phi)
    y, dy = -z_imu * s, -z_imu * c * p
    ddy, ddz = -z_imu * (c * ddphi - s * p * p), -z_imu * (s * ddphi + c * p * p)
    fx = dv - vy * r - x_imu * r * r - y * dr - 2 * r * dy
    bank = slope * np.cos(psi - slope_heading)
    fy = dvy + v * r + x_imu * dr + ddy - r * r * y + GRAVITY * np.sin(bank)
    fz = ddz + GRAVITY * np.cos(bank)
    rates = np.column_stack([p, s * r, c * r])
    force = np.column_stack([fx, c * fy + s * fz, -s * fy + c * fz])
    return rates, force, np.column_stack([v - y * r, vy + x_imu * r + dy])


def turned(roll: float, pitch: float, yaw: float) -> Array:
    """Matrix from vehicle axes to those of an IMU mounted at these ISO angles (yaw, pitch, then roll)."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(q), np.sin(q)) for q in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
    about_y = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    about_z = np.array([[cy, sy, 0], [-sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_x @ about_y @ about_z)


def measure(
    motion: Motion,
    rover: Rover,
    off: Nuisance,
    hidden: Hidden,
    rough: Roughness,
    filters: tuple[float, float],
    rng: Rng,
) -> Measured:
    """The autopilot's signals; filters: INS_GYRO_FILTER, INS_ACCEL_FILTER [Hz]."""
    slope, downhill = part(hidden, "cross_slope", "b", 0.0), part(hidden, "cross_slope", "psi0", 0.0)
    rates, force, speed = kinematics(motion, rover.imu_x, rover.imu_z, slope, downhill)
    tilt = {name: part(hidden, "imu_tilt", name, 0.0) for name in ("roll", "pitch", "yaw")}
    mounted = turned(**tilt).T
    n, moving = motion.t.size, np.clip(motion[4] / 0.5, 0.0, 1.0)[:, None]
    rates = rates @ mounted + rough.gyro * (0.15 + 0.85 * moving) * rng.normal(size=(n, 3)) * np.array(
        [1.0, 1.0, 0.6]
    )
    shake = rough.vibration * moving * _vibration(rng, n) + 0.03 * rng.normal(size=(n, 3))
    force = force @ mounted + shake
    rates = low_pass(
        lag(low_pass(rates, part(hidden, "sensor_filter", "gyro_hz", np.inf)), off.gyro_lag), filters[0]
    )
    force = low_pass(
        lag(low_pass(force, part(hidden, "sensor_filter", "accel_hz", np.inf)), off.accel_lag), filters[1]
    )
    rates = rates + np.array([off.gyro_bias[0], 0.0, off.gyro_bias[1]])
    force = force + np.array([0.0, off.ay_bias, 0.0])
    phi = motion[2] + slope * np.cos(motion[5] - downhill) + tilt["roll"] + off.ay_bias / GRAVITY
    phi = phi + 0.003 * coloured(rng, n, 0.3)
    psi = motion[5] + tilt["yaw"] + off.heading_error + rough.heading * coloured(rng, n, 0.2)
    velocity, position = _navigation(motion, speed, off, hidden, rough, rng)
    return Measured(motion.t, rates, force, velocity, position, phi, psi)


def _vibration(rng: Rng, n: int) -> Array:
    """Band noise (n, 3) of unit rms about 70 Hz, as motor and drive train give."""
    rough = rng.normal(size=(n, 3))
    band = lfilter([1.0, 0.0, -1.0], [1.0, -1.75, 0.9], rough, axis=0)
    return np.asarray(band / band.std())


def _navigation(
    motion: Motion, speed: Array, off: Nuisance, hidden: Hidden, rough: Roughness, rng: Rng
) -> tuple[Array, Array]:
    """EKF velocity and position (n, 2), north and west: scaled, lagged, wandering as with GPS."""
    c, s = np.cos(motion[5]), np.sin(motion[5])
    velocity = np.column_stack([c * speed[:, 0] - s * speed[:, 1], s * speed[:, 0] + c * speed[:, 1]])
    velocity = off.speed_scale * velocity
    velocity = lag(lag(velocity, off.ekf_lag), part(hidden, "velocity_lag", "T", 0.0))
    n = motion.t.size
    wander = np.column_stack([coloured(rng, n, 0.3), coloured(rng, n, 0.3)])
    ripple = np.column_stack([coloured(rng, n, 15.0), coloured(rng, n, 15.0)])
    velocity = velocity + rough.wander * wander + 0.003 * ripple
    return velocity, np.column_stack([motion[6], motion[7]])
