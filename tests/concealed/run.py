"""One run of the rover: from the PWM on the servo line to the true motion on the 1 kHz clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tests.concealed import motion
from tests.concealed.drive import FADE, T_REC, Drive, Steering
from tests.concealed.effects import Hidden, part
from tests.concealed.rover import GRAVITY, Nuisance, Rng, Rover

Array = NDArray[np.float64]
LOOP = 0.010  # s: main loop of the firmware, SCHED_LOOP_RATE 100


@dataclass(frozen=True)
class Roughness:
    """Disturbances on this ground and in this rover, rms.

    side force over weight, roll moment over weight x h, throttle [m/s^2], vibration [m/s^2], gyro [rad/s at
    1 kHz]; of the EKF: wander of the velocity [m/s], heading [rad].
    """

    side: float
    roll: float
    throttle: float
    vibration: float
    gyro: float
    wander: float
    heading: float


def draw_roughness(rng: Rng) -> Roughness:
    u = rng.uniform
    return Roughness(
        u(0.007, 0.012),
        u(0.008, 0.018),
        u(0.02, 0.05),
        u(0.1, 0.2),
        u(0.006, 0.012),
        u(0.008, 0.02),
        u(0.002, 0.004),
    )


@dataclass(frozen=True, eq=False)
class Motion:
    """True motion: t (n,) s of the log, x (n, 24) states and rates of `motion.drive`, delta (n,) rad."""

    t: Array
    x: Array
    delta: Array

    def __getitem__(self, k: int) -> Array:
        return self.x[:, k]


def coloured(rng: Rng, n: int, corner: float) -> Array:
    """First-order noise (n,) of unit rms at 1 kHz; corner [rad/s]."""
    keep = np.exp(-corner * motion.STEP)
    return lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], rng.normal(size=n))


def move(
    rover: Rover, off: Nuisance, drive: Drive, steering: Steering, hidden: Hidden, rough: Roughness, rng: Rng
) -> Motion:
    """Drives the run: servo and linkage, then the motion with the road's disturbances."""
    n = int(drive.length / motion.STEP)
    t: Array = np.arange(n, dtype=np.float64) * motion.STEP
    delta = road_wheel(rover, off, t, steering, hidden)
    speed = speed_wanted(drive, t)
    weight = rover.m * GRAVITY
    push = np.column_stack(
        [
            rough.side * weight / 2 * coloured(rng, n, 50.0),
            rough.side * weight / 2 * coloured(rng, n, 50.0),
            rough.roll * weight * rover.h * coloured(rng, n, 40.0),
            rough.throttle * coloured(rng, n, 2.0),
        ]
    )
    push *= np.where(speed > 0, 1.0, 0.0)[:, None]
    motor = rng.uniform(0.4, 0.7)
    q = motion.vector({**_rover_numbers(rover), **_effect_numbers(rover, hidden, drive), "motor_lag": motor})
    return Motion(t, motion.drive(q, delta, speed, push, drive.heading), delta)


def _rover_numbers(rover: Rover) -> dict[str, float]:
    names = ("m", "ms", "a", "b", "h", "izz", "ixx", "k_phi", "b_phi", "cf", "cr", "friction")
    return {name: getattr(rover, name) for name in names}


def _effect_numbers(rover: Rover, hidden: Hidden, drive: Drive) -> dict[str, float]:
    """What the motion needs of the concealed effects; moments out of the library scale with the rover."""
    ratio = part(hidden, "front_rear_stiffness", "ratio", rover.cf / rover.cr)
    total = rover.cf + rover.cr
    here = [one for one in hidden if one.id == "surface_change" and one.run == drive.name]
    base = rover.a + rover.b
    side = rover.m * GRAVITY * base
    return {
        "cf": total * ratio / (1 + ratio),
        "cr": total / (1 + ratio),
        "sigma": part(hidden, "tyre_relaxation", "sigma", 0.0),
        "mu": part(hidden, "tyre_saturation", "mu", 0.0),
        "load_transfer": part(hidden, "load_transfer", "k", 0.0),
        "roll_steer": part(hidden, "roll_steer", "e", 0.0),
        "dry_friction": part(hidden, "suspension_friction", "T", 0.0),
        "drag": part(hidden, "speed_variation", "D", 0.0),
        "change_ratio": here[0].parameters["ratio"] if here else 1.0,
        "change_time": change_instant(drive, here[0].detail["fraction"]) if here else 0.0,
        "slope": part(hidden, "cross_slope", "b", 0.0),
        "slope_heading": part(hidden, "cross_slope", "psi0", 0.0),
        "scrub": part(hidden, "locked_differential", "scrub", 0.0) * base * total / 10,
        "scrub_threshold": part(hidden, "locked_differential", "threshold", 0.0),
        "flex_gain": part(hidden, "flexing_chassis", "flex", 0.0) * rover.m * base,
        "wind": part(hidden, "side_wind", "wind", 0.0) * side / 10,
        "wind_heading": part(hidden, "side_wind", "heading", 0.0),
    }


def change_instant(drive: Drive, fraction: float) -> float:
    """Instant of a change of surface at `fraction` of the wave, s of the log."""
    return drive.start + drive.straight + 2 * FADE + fraction * T_REC


def speed_wanted(drive: Drive, t: Array) -> Array:
    """Speed the throttle asks for (n,), m/s: 0 parked, then a ramp of about 2 m/s^2, 0 after the end."""
    go = drive.parked + drive.still + 0.3
    ramp = np.clip((t - go) * 2.0, 0.0, drive.speed)
    return np.where(
        t < drive.stop + 0.5, ramp, np.clip(drive.speed - (t - drive.stop - 0.5) * 2.5, 0.0, None)
    )


def road_wheel(rover: Rover, off: Nuisance, t: Array, steering: Steering, hidden: Hidden) -> Array:
    """Road-wheel angle (n,) rad: the PWM waits for the main loop, then for the delay, servo and linkage."""
    delay = part(hidden, "transport_delay", "T", off.delay)
    taken = np.ceil(steering.t / LOOP) * LOOP + delay
    k = np.searchsorted(taken, t, "right") - 1
    pwm = np.where(k >= 0, steering.out[np.maximum(k, 0)], 1500.0)
    u = -(pwm - 1500.0) * rover.rad_per_us
    # A long delay leaves little lag and a long lag little delay: one of the two is the effect.
    lag = part(hidden, "servo_lag", "T", off.servo_lag)
    second = min(0.2 * lag, 0.008)
    d = motion.servo(
        u,
        lag - second,
        second,
        part(hidden, "servo_rate_limit", "R", 1e9),
        part(hidden, "steering_deadband", "w", 0.0),
        part(hidden, "steering_backlash", "b", 0.0),
        part(hidden, "steering_nonlinearity", "c3", 0.0),
        part(hidden, "steering_asymmetry", "e", 0.0),
    )
    return np.asarray(d) - part(hidden, "steering_trim", "u0", off.trim)
