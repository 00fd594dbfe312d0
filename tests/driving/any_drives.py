"""Hand driving and missions of the simulated rover, as logs: the plant on drawn steering and speed."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from sitl.plant.variant import PlantParameters
from sitl.redrive.course import Array, Course
from sitl.redrive.open_loop import redrive

STEP = 0.02  # s, of the main loop
GRAVITY = 9.81
OUTPUTS = {"SERVO1_FUNCTION": 26, "SERVO3_FUNCTION": 70, "INS_GYRO_FILTER": 20}


def hand_driving(seconds: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Steering about the trim [us] and speed [m/s] (n,): a stick at a finite rate, gas as one likes."""
    n = round(seconds / STEP)
    wanted, speed = np.zeros(n), np.zeros(n)
    k = 0
    while k < n:
        more = round(rng.uniform(0.3, 3) / STEP)
        wanted[k : k + more] = rng.choice([0, 1, 1]) * rng.normal(0, 110)
        k += more
    k = 0
    while k < n:
        more = round(rng.uniform(8, 40) / STEP)
        speed[k : k + more] = rng.uniform(0.8, 2.8)
        k += more
    stick, at = np.zeros(n), 0.0
    for i in range(n):
        at += float(np.clip(wanted[i] - at, -600 * STEP, 600 * STEP))
        stick[i] = at
    return stick, gaussian_filter1d(speed, 1.0 / STEP)


def mission(seconds: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Straight legs and corners as an autopilot steers them, slower in the corners."""
    n = round(seconds / STEP)
    steering, k = np.zeros(n), 0
    while k < n:
        k += round(rng.uniform(4, 9) / STEP)
        corner, side = round(rng.uniform(1.0, 1.8) / STEP), rng.choice([-1, 1]) * rng.uniform(90, 190)
        steering[k : k + corner] = side
        steering[k + corner : k + corner + round(0.6 / STEP)] = -0.25 * side
        k += corner + round(0.6 / STEP)
    share = STEP / 0.12
    steering = lfilter([share], [1, share - 1], steering) + rng.normal(0, 1.5, n)
    speed = 2.0 - 0.4 * np.minimum(1, np.abs(steering) / 150)
    return steering, gaussian_filter1d(speed, 1.0 / STEP)


def recorded(steering: Array, speed: Array, rover: PlantParameters, out: Path, seed: int) -> Path:
    """The log of the rover that drives this, from standstill."""
    t = 10 + STEP * np.arange(steering.size)
    begin = round(3 / STEP)
    speed = np.concatenate((np.linspace(0, speed[begin], begin), speed[begin:]))
    pwm = rover.steering_trim_us + np.round(steering)
    redrive(Course(t, pwm, speed, t, pwm, parameters=OUTPUTS), rover, out, seed)
    return out


@dataclass(frozen=True)
class TrueSteering:
    """Of the linear bicycle at zero slip: curvature at low speed and at the speed [1/m per 100 us], K_us
    [deg/g], response time [s]."""

    curvature: float
    at_speed: float
    understeer_gradient: float
    response_time: float


def true_steering(rover: PlantParameters, speed: float) -> TrueSteering:
    """The numbers that driving should show at this speed. The response time: that of slow steering.

    r/delta = (B1 s + B0)/(m I s^2 + D1 s + D0) is late by D1/D0 - B1/B0 at low frequency.
    """
    m, a, b = rover.mass, rover.cg_to_front_axle, rover.cg_to_rear_axle
    front, rear = rover.front_cornering_stiffness, rover.rear_cornering_stiffness
    wheelbase, both = a + b, front * rear * (a + b)
    d1 = m * (a**2 * front + b**2 * rear) + rover.yaw_inertia * (front + rear)
    d0 = both * wheelbase / speed - m * speed * (a * front - b * rear)
    late = d1 / d0 - a * front * m * speed / both
    curvature, gradient = 100 * rover.rad_per_us / wheelbase, m / wheelbase * (b / front - a / rear)
    return TrueSteering(
        curvature,
        curvature / (1 + gradient * speed**2 / wheelbase),
        degrees(gradient) * GRAVITY,
        rover.servo_delay + rover.servo_lag + late,
    )
