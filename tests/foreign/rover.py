"""A drawn rover: its numbers, its instruments, its surroundings, and what its owner wrote down.

Sizes from 2 to 420 kg. The small mismatches of every rover lie within the default [material].
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.random import Generator

from tests.foreign.plant import Numbers

GRAVITY = 9.81


@dataclass(frozen=True)
class Size:
    """Ranges of a class: mass [kg], wheelbase [m], speed [m/s], roll mode [rad/s], stiffness/load [1/rad]."""

    name: str
    mass: tuple[float, float]
    base: tuple[float, float]
    speed: tuple[float, float]
    roll_mode: tuple[float, float]
    grip: tuple[float, float]


SIZES = (
    Size("2-4 kg", (2.0, 4.0), (0.34, 0.45), (1.8, 2.5), (19.0, 24.0), (2.0, 3.2)),
    Size("8-20 kg", (8.0, 20.0), (0.5, 0.7), (2.2, 3.2), (16.0, 21.0), (2.8, 4.2)),
    Size("40-90 kg", (40.0, 90.0), (0.8, 1.0), (2.8, 4.0), (13.0, 17.0), (3.5, 5.0)),
    Size("200-420 kg", (200.0, 420.0), (1.3, 1.8), (3.6, 5.2), (10.0, 13.5), (4.5, 6.5)),
)


@dataclass(frozen=True)
class Instruments:
    """Firmware's rates and filters [Hz], and the small errors of every sensor (ISO axes, SI units)."""

    loop_hz: float
    ekf_hz: float
    gyro_hz: float
    accel_hz: float
    imu_x: float
    imu_z: float  # above the roll axis
    tilt: tuple[float, float, float]
    gyro_bias: tuple[float, float]  # r, p
    accel_bias: float
    speed_scale: float
    ekf_lag: float
    ekf_gain: float
    ekf_yaw: float  # error of the heading
    gyro_noise: float  # rad/s at 1 kHz
    accel_noise: float  # m/s^2 at 1 kHz
    # effects
    gyro_lag: float = 0.0
    gyro_form: str = ""
    accel_lag: float = 0.0
    gyro_scale: float = 1.0
    accel_scale: float = 1.0
    velocity_lag: float = 0.0
    velocity_form: str = ""
    wheel_radius: float = 0.05
    unbalance: float = 0.0
    tone: float = 0.0
    tone_hz: float = 2.0
    mast: float = 0.0
    mast_w: float = 18.0


@dataclass(frozen=True)
class Surroundings:
    """What changes with time. road: rms of the side acceleration, yaw and roll acceleration by the road.

    surface_form: when the stiffness becomes `surface` of what it was. run, at [s]: which run and when.
    """

    road: tuple[float, float, float]
    surface: float = 1.0
    surface_form: str = ""
    run: int = 2
    at: float = 25.0
    wind: float = 0.0  # m/s^2
    wind_heading: float = 0.0
    gusts: float = 0.25
    shift: float = 0.0  # m, CG forward from `at` in `run` on
    hold: float = 0.0  # s, frame of the servo
    limp: float = 0.0  # N m, yaw moment of a motor that fails in a part of every period
    limp_period: float = 1.0  # s


@dataclass(frozen=True)
class Rover:
    """A rover, its speed [m/s] and large amplitude [rad], and the vehicle file's numbers in `told`."""

    size: str
    numbers: Numbers
    instruments: Instruments
    surroundings: Surroundings
    rad_per_us: float
    trim_us: float
    delay: float
    speed: float
    amplitude: float
    told: dict[str, Any] = field(default_factory=dict)

    def of(self, **numbers: float) -> Rover:
        """The rover with other numbers."""
        return replace(self, numbers=self.numbers._replace(**{k: float(v) for k, v in numbers.items()}))

    def sensing(self, **instruments: Any) -> Rover:
        """The rover with other instruments."""
        return replace(self, instruments=replace(self.instruments, **instruments))

    def amid(self, **surroundings: Any) -> Rover:
        """The rover in other surroundings."""
        return replace(self, surroundings=replace(self.surroundings, **surroundings))


def draw_rover(rng: Generator, size: Size) -> Rover:
    """A rover without any effect."""
    m, base = rng.uniform(*size.mass), rng.uniform(*size.base)
    speed = rng.uniform(*size.speed)
    a = base * rng.uniform(0.46, 0.54)
    numbers = _numbers(rng, size, m, a, base - a)
    ay = rng.uniform(2.8, 3.6)
    gain = _gain(numbers, speed)
    amplitude = float(np.clip(ay / gain, 0.09, 0.26))
    rad_per_us = 10 ** rng.uniform(np.log10(6e-4), np.log10(1.1e-3))
    us = 2 * round(amplitude / rad_per_us / 2)
    rover = Rover(
        size.name,
        numbers,
        _instruments(rng, numbers, base),
        Surroundings(_road(rng)),
        rad_per_us,
        1500.0 + rng.uniform(-0.006, 0.006) / rad_per_us,
        rng.uniform(0.006, 0.020),
        speed,
        us * rad_per_us,
    )
    return replace(rover, told=_told(rng, rover, base))


def _numbers(rng: Generator, size: Size, m: float, a: float, b: float) -> Numbers:
    base = a + b
    ms, h = m * rng.uniform(0.86, 0.92), base * rng.uniform(0.14, 0.18)
    ixx = ms * (base * rng.uniform(0.18, 0.23)) ** 2
    about_axis, w = ixx + ms * h * h, rng.uniform(*size.roll_mode)
    grip, ratio = rng.uniform(*size.grip), np.exp(rng.uniform(-0.12, 0.12))
    heavy = SIZES.index(size) / 3
    lag = rng.uniform(0.014, 0.022) + 0.008 * heavy
    return Numbers(
        m=m,
        ms=ms,
        a=a,
        b=b,
        track=base * rng.uniform(0.68, 0.85),
        Izz=m * a * b * rng.uniform(0.68, 0.9),
        Ixx=ixx,
        h=h,
        kphi=about_axis * w * w + ms * GRAVITY * h,
        bphi=2 * rng.uniform(0.32, 0.55) * w * about_axis,
        roll_axis=base * rng.uniform(0.12, 0.2),
        Cf=grip * m * GRAVITY / 2 * float(np.sqrt(ratio)),
        Cr=grip * m * GRAVITY / 2 / float(np.sqrt(ratio)),
        ackermann=rng.uniform(0.0, 0.5),
        gain=1 / lag,
        motor_lag=rng.uniform(0.002, 0.0035),
        rate=25.0,
        rate_form=0.0,
        tau_drive=0.3 + 0.6 * heavy,
        most_drive=2.5,
        rolling=0.02,
    )


def _gain(n: Numbers, speed: float) -> float:
    """Steady a_y per rad of a single-track model (Pacejka 2012, 1.3)."""
    base = n.a + n.b
    return speed**2 / (base + n.m * (n.b * n.Cr - n.a * n.Cf) / (base * n.Cf * n.Cr) * speed**2)


def _road(rng: Generator) -> tuple[float, float, float]:
    level = rng.uniform(0.7, 1.3)
    return 0.16 * level, 0.3 * level, 0.3 * level


def _instruments(rng: Generator, n: Numbers, base: float) -> Instruments:
    loop, ekf = [(50.0, 50.0), (100.0, 50.0), (200.0, 25.0), (200.0, 50.0)][rng.integers(4)]
    return Instruments(
        loop_hz=loop,
        ekf_hz=ekf,
        gyro_hz=float(rng.choice([4.0, 20.0])),
        accel_hz=float(rng.choice([10.0, 20.0])),
        imu_x=_within(rng, 0.1 * base, 0.1 * base),
        imu_z=n.h * rng.uniform(0.2, 1.3),
        tilt=(_within(rng, 0.004, 0.008), _within(rng, 0.004, 0.008), _within(rng, 0.004, 0.008)),
        gyro_bias=(_within(rng, 0.003, 0.008), _within(rng, 0.003, 0.008)),
        accel_bias=_within(rng, 0.08, 0.2),
        speed_scale=1 + _within(rng, 0.008, 0.015),
        ekf_lag=rng.uniform(0.0, 0.007),
        ekf_gain=1 + _within(rng, 0.03, 0.06),
        ekf_yaw=_within(rng, 0.015, 0.03),
        gyro_noise=rng.uniform(0.012, 0.022),
        accel_noise=rng.uniform(0.4, 0.8),
        wheel_radius=0.16 * base,
    )


def _within(rng: Generator, sd: float, bound: float) -> float:
    return float(np.clip(rng.normal(0.0, sd), -bound, bound))


def _told(rng: Generator, rover: Rover, base: float) -> dict[str, Any]:
    """What the owner measured: off by no more than the default [material] of a vehicle file."""
    n, place = rover.numbers, min(max(0.006, 0.01 * base), 0.010)
    h = n.h * (1 + _within(rng, 0.05, 0.1))
    told = {
        "mass": n.m * (1 + _within(rng, 0.003, 0.006)),
        "sprung_mass": n.ms * (1 + _within(rng, 0.004, 0.008)),
        "cg_to_front_axle": n.a + _within(rng, place / 2, place),
        "cg_height_above_roll_centre": h,
        "roll_inertia": n.Ixx * (1 + _within(rng, 0.07, 0.15)),
        "rad_per_us": rover.rad_per_us * (1 + _within(rng, 0.015, 0.03)),
        "imu_x": rover.instruments.imu_x + _within(rng, 0.003, 0.006),
        "imu_z": rover.instruments.imu_z + _within(rng, 0.003, 0.006),
    }
    told["cg_to_rear_axle"] = base * (1 + _within(rng, 0.002, 0.004)) - told["cg_to_front_axle"]
    if rng.uniform() < 0.4:
        told["yaw_inertia"] = n.Izz * (1 + _within(rng, 0.05, 0.1))
    return {key: float(f"{value:.4g}") for key, value in told.items()}


def vehicle_toml(told: dict[str, Any]) -> str:
    """The vehicle file of what the owner wrote down."""
    own = ("rad_per_us", "imu_x", "imu_z")
    lines = ["[vehicle]", *(f"{key} = {value!r}" for key, value in told.items() if key not in own)]
    down = told["cg_height_above_roll_centre"] - told["imu_z"]  # of the CG of the sprung mass
    lines += ["[steering]", "trim_us = 1500", f"rad_per_us = {told['rad_per_us']!r}"]
    return "\n".join([*lines, "[imu]", f"position = [{told['imu_x']!r}, 0.0, {down!r}]", ""])
