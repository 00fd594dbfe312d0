"""What the firmware logs of a motion: IMU through its low-pass, attitude and velocity of the EKF."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

from tests.foreign.chassis import GRAVITY
from tests.foreign.motion import COLUMNS, DT
from tests.foreign.rover import Instruments, Rover
from tests.foreign.surroundings import coloured

Array = NDArray[np.float64]
QUIET = 0.03  # share of the accelerometer's vibration at standstill


def felt(motion: Array, rover: Rover) -> dict[str, Array]:
    """Undisturbed signals (steps,) at the IMU: r, p, ay, vy, speed, phi, psi; unfiltered."""
    i, n = rover.instruments, rover.numbers
    u, v, r, phi, p, psi, v_dot, r_dot, p_dot, _, gy, shift = (motion[:, k] for k in range(len(COLUMNS)))
    cos, sin, z = np.cos(phi), np.sin(phi), i.imu_z
    forward = i.imu_x - shift  # from the CG, where it is now
    across = v_dot + u * r + r_dot * forward - z * (cos * p_dot - sin * p * p) + r * r * z * sin - gy
    up = -z * (sin * p_dot + cos * p * p) + GRAVITY * np.cos(n.slope)
    ahead = -v * r - r * r * forward
    ay, az = cos * across + sin * up, cos * up - sin * across
    return {
        **mounted(r * cos, p.copy(), (ahead, ay, az), i),
        "vy": v + r * forward - z * cos * p,
        "speed": u,
        "phi": phi,
        "psi": psi,
    }


def mounted(turn: Array, roll: Array, force: tuple[Array, Array, Array], i: Instruments) -> dict[str, Array]:
    """r, p and ay of an IMU that may be tilted or on a mast. force: specific force, body axes, m/s^2."""
    ahead, ay, az = force
    if i.mast > 0:
        ay, roll = _on_mast(ay, roll, i)
    about_x, about_y, about_z = i.tilt
    return {
        "r": turn + about_y * roll,
        "p": np.cos(about_z) * roll - about_y * turn,
        "ay": ay + np.sin(about_x) * az - np.sin(about_z) * ahead,
    }


def _on_mast(ay: Array, p: Array, i: Instruments) -> tuple[Array, Array]:
    """The IMU on a mast that bends by `mast` [rad] at 1 g, lightly damped."""
    w, zeta, b, db = i.mast_w, 0.06, np.zeros(ay.size), np.zeros(ay.size)
    x = y = 0.0
    for k in range(ay.size):  # semi-implicit Euler
        y += DT * (w * w * (i.mast * ay[k] / GRAVITY - x) - 2 * zeta * w * y)
        x += DT * y
        b[k], db[k] = x, y
    return ay + GRAVITY * b, p + db


def filtered(x: Array, cutoff_hz: float) -> Array:
    """ArduPilot's LowPassFilter2p: a second-order Butterworth low-pass by the bilinear transform."""
    top, bottom = butter(2, cutoff_hz * 2 * DT)
    return np.asarray(lfilter(top, bottom, x - x[0])) + x[0]


def lagged(x: Any, lag: float, form: str) -> Any:
    """Through another low-pass, "first order" or "second order" (double pole), or a "delay", of `lag` s."""
    if lag <= 0:
        return x
    if form == "delay":
        at = np.maximum(np.arange(x.size) - round(lag / DT), 0)
        return x[at]
    orders = 2 if form == "second order" else 1
    keep = np.exp(-DT * orders / lag)
    for _ in range(orders):
        x = lfilter([1 - keep], [1.0, -keep], x - x[0]) + x[0]
    return x


def sensed(
    undisturbed: Mapping[str, Array], i: Instruments, rng: Generator, noise: bool = True
) -> dict[str, Array]:
    """Signals (steps,) in the firmware before they are sampled, of undisturbed ones as `felt` returns them.

    noise: of the sensors and the EKF.
    """
    x = dict(undisturbed)
    steps, turning = x["r"].size, 1 / i.wheel_radius
    if i.unbalance:
        x["ay"] = x["ay"] + i.unbalance * np.sin(np.cumsum(x["speed"]) * DT * turning) * np.tanh(x["speed"])
    if i.tone:
        wander = coloured(np.random.default_rng(int(1e6 * abs(x["psi"][0]))), steps, 1.0)
        phase = 2 * np.pi * np.cumsum(i.tone_hz * (1 + 0.1 * wander)) * DT
        x["ay"] = x["ay"] + i.tone * np.sin(phase) * np.tanh(x["speed"])
        x["p"] = x["p"] + 0.03 * i.tone * np.sin(phase + 1.0) * np.tanh(x["speed"])
    scale = {"r": i.gyro_scale, "p": i.gyro_scale, "ay": i.accel_scale}
    bias = {"r": i.gyro_bias[0], "p": i.gyro_bias[1], "ay": i.accel_bias}
    running = QUIET + (1 - QUIET) * np.tanh(np.abs(x["speed"]))
    levels = {"r": i.gyro_noise, "p": 3 * i.gyro_noise, "ay": i.accel_noise}
    for name, level in levels.items():
        raw = scale[name] * x[name] + bias[name]
        if noise:
            raw = raw + level * running * rng.normal(size=steps)
        raw = lagged(raw, i.accel_lag if name == "ay" else i.gyro_lag, "" if name == "ay" else i.gyro_form)
        x[name] = filtered(raw, i.accel_hz if name == "ay" else i.gyro_hz)
    return x | _estimated(x, i, rng, steps, noise)


def _estimated(
    x: dict[str, Array], i: Instruments, rng: Generator, steps: int, noise: bool
) -> dict[str, Array]:
    """Velocity and attitude of the EKF: a small lag over ground, a wrong heading, slow errors."""
    towards = np.exp(1j * x["psi"])
    ground = (x["speed"] + 1j * x["vy"]) * towards  # the EKF holds the velocity in earth axes
    over = lagged(lagged(ground, i.ekf_lag, ""), i.velocity_lag, i.velocity_form) * np.conj(towards)
    found = {"vy": i.ekf_gain * over.imag, "speed": i.speed_scale * over.real}
    found["vy"] = found["vy"] + i.ekf_yaw * found["speed"]
    if noise:
        running = 0.2 + 0.8 * np.tanh(np.abs(x["speed"]))
        for name, level, lag in (("vy", 0.006, 0.6), ("speed", 0.008, 0.8)):
            found[name] = found[name] + level * running * coloured(rng, steps, lag)
        found["phi"] = x["phi"] + 0.0006 * running * coloured(rng, steps, 1.0)
        found["psi"] = x["psi"] + 0.002 * running * coloured(rng, steps, 3.0)
    return found
