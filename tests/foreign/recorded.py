"""The runs of a set: how they are driven, in which surroundings, and what the firmware logs of them.

Sweep, sweep of twice the amplitude, sweep at another speed, doublets (held out).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import butter, lfilter

from rover_sweep.api.read import Runs, with_delta
from rover_sweep.data.recording import LowPass, Recording, Signal
from rover_sweep.data.vehicle_file import parse
from tests.foreign.plant import (
    COLUMNS,
    DT,
    GRAVITY,
    ROAD_ROLL,
    ROAD_Y,
    ROAD_YAW,
    SHIFT,
    STATES,
    SURFACE,
    WIND_X,
    WIND_Y,
    integrated,
)
from tests.foreign.rover import Instruments, Rover, vehicle_toml

Array = NDArray[np.float64]
W_MIN, W_MAX, SWEPT, FADE, DWELL = 0.5, 25.0, 51.0, 2.0, 2.0  # rad/s and s; 55 s up to the fade-out
C1, C2 = 4.0, 0.0187  # Tischler and Remple 2012, 5.11
STILL, RUN_UP, STRAIGHT, BRAKING, AFTER = 4.0, 7.0, 3.0, 4.0, 6.0  # s
PULSES = ((1.0, 1.0, 2.0), (1.5, -1.0, 2.0), (0.6, 1.0, 2.0))  # half length [s], sign, pause [s]


@dataclass(frozen=True)
class Drive:
    """One run: amplitude [us], speed [m/s], heading [rad] at rest, opening of the log [s since boot]."""

    name: str
    kind: Literal["sweep", "doublet"]
    amplitude: float
    speed: float
    heading: float
    opened: float

    @property
    def begin(self) -> float:
        """Start of the manoeuvre, with its straight stretch, s from the opening of the log."""
        return STILL + RUN_UP

    @property
    def wave_length(self) -> float:
        """Seconds from the first to the last deflection."""
        if self.kind == "sweep":
            return 2 * FADE + DWELL + SWEPT
        return sum(2 * half + pause for half, _, pause in PULSES)

    @property
    def end(self) -> float:
        """End of the manoeuvre, s from the opening of the log."""
        return self.begin + 2 * STRAIGHT + self.wave_length

    @property
    def length(self) -> float:
        """Of the log, s."""
        return self.end + BRAKING + AFTER


def drives(rng: Generator, rover: Rover) -> tuple[Drive, ...]:
    """Four runs; the large amplitude is the rover's."""
    large = rover.amplitude / rover.rad_per_us
    second = rover.speed * rng.uniform(0.64, 0.76)
    rows = (
        ("run1", "sweep", large / 2, rover.speed),
        ("run2", "sweep", large, rover.speed),
        ("run3", "sweep", 0.62 * large, second),
        ("run4", "doublet", 0.62 * large, rover.speed),
    )
    opened, found = rng.uniform(35.0, 60.0), []
    for name, kind, amplitude, speed in rows:
        drive = Drive(
            name,
            kind,
            float(round(amplitude)),
            speed,
            rng.uniform(-np.pi, np.pi),
            opened,  # type: ignore[arg-type]
        )
        found.append(drive)
        opened += drive.length + rng.uniform(5.0, 40.0)
    return tuple(found)


def wave(drive: Drive, t: Array) -> Array:
    """Deflection (n,) in shares of the amplitude at t (n,) [s] since the opening of the log."""
    x = t - drive.begin - STRAIGHT
    if drive.kind == "doublet":
        return _doublets(x)
    swept = np.clip(x - FADE - DWELL, 0.0, SWEPT)
    grown = np.expm1(C1 * swept / SWEPT)
    phase = W_MIN * np.clip(x, 0.0, FADE + DWELL + SWEPT)
    phase += C2 * (W_MAX - W_MIN) * (SWEPT / C1 * grown - swept)
    phase += W_MAX * np.clip(x - FADE - DWELL - SWEPT, 0.0, FADE)
    window = np.clip(np.minimum(x, drive.wave_length - x) / FADE, 0.0, 1.0)
    return window * np.sin(phase)


def _doublets(x: Array) -> Array:
    out, start = np.zeros_like(x), 0.0
    for half, sign, pause in PULSES:
        out += sign * ((x >= start) & (x < start + half))
        out -= sign * ((x >= start + half) & (x < start + 2 * half))
        start += 2 * half + pause
    return out


def loop_instants(drive: Drive, loop_hz: float) -> Array:
    """(n,) s since the opening of the log: main loops, whose clock runs .04 % fast."""
    step = (1 - 4e-4) / loop_hz
    return np.round(np.arange(int(drive.length / step)) * step, 6)


def output_us(drive: Drive, rover: Rover, rng: Generator) -> tuple[Array, Array]:
    """(t, PWM) at the main loops: the applet has a turn about every 12 ms, the output is whole us."""
    t = loop_instants(drive, rover.instruments.loop_hz)
    turns = np.cumsum(rng.choice([0.0115, 0.0125, 0.015], int(drive.length / 0.0115)))
    wanted = 1500.0 + drive.amplitude * wave(drive, turns)
    at = np.searchsorted(turns, t, "right") - 1
    return t, np.where(at < 0, 1500.0, np.round(wanted[np.maximum(at, 0)]))


def command(drive: Drive, rover: Rover, t_out: Array, us: Array) -> Array:
    """(steps,) rad, left positive: the PWM as the servo acts on it, after its delay, on the steps of DT."""
    t = np.arange(int(drive.length / DT)) * DT - rover.delay
    if rover.surroundings.hold > 0:  # the servo reads its input once a frame
        t = np.floor(t / rover.surroundings.hold) * rover.surroundings.hold
    at = np.maximum(np.searchsorted(t_out, t, "right") - 1, 0)
    return -(us[at] - rover.trim_us) * rover.rad_per_us


def wanted_speed(drive: Drive) -> Array:
    """(steps,) m/s."""
    t = np.arange(int(drive.length / DT)) * DT
    return np.where((t > STILL) & (t < drive.end + 0.5), drive.speed, 0.0)


# ---- Road, wind, surface and load along a run, on the steps of the integrator.

ROAD_LAG = 0.08  # s: a correlation length of some 20 cm
GUST_LAG = 2.5  # s
RAMP = 8.0  # s
SLIDE = 0.5  # s, of the load
WARMING = 150.0  # s
FAILED = 0.45  # share of the period in which a motor fails


def around(rover: Rover, drive: Drive, rng: Generator, noise: bool = True) -> Array:
    """(steps, 7) in the columns of `chassis`; noise: with a road."""
    n, s = rover.numbers, rover.surroundings
    t = np.arange(int(drive.length / DT)) * DT
    out = np.zeros((t.size, 7))
    out[:, SURFACE] = _surface(rover, drive, t)
    slid = (
        np.clip((t - drive.begin - s.at) / SLIDE, 0.0, 1.0)
        if _number(drive) == s.run
        else _number(drive) > s.run
    )
    out[:, SHIFT] = s.shift * slid
    if s.wind:
        force = n.m * s.wind * (1 + s.gusts * coloured(_same_gusts(drive), t.size, GUST_LAG))
        out[:, WIND_X] = force * np.cos(s.wind_heading)
        out[:, WIND_Y] = force * np.sin(s.wind_heading)
    if s.limp:
        driven = (t > STILL + 2.0) & (t < drive.end)
        out[:, ROAD_YAW] = s.limp * driven * ((t / s.limp_period) % 1.0 < FAILED)
    if noise:
        rolls = np.clip((t - drive.begin + 5.0) / 2.0, 0.0, 1.0) * (t < drive.end + 1.0)
        scales = (n.m, n.Izz, n.Ixx + n.ms * n.h**2)
        share = min(1.3, drive.speed / rover.speed)
        for column, level, scale in zip((ROAD_Y, ROAD_YAW, ROAD_ROLL), s.road, scales, strict=True):
            out[:, column] += share * level * scale * coloured(rng, t.size, ROAD_LAG) * rolls
    return out


def coloured(rng: Generator, size: int, lag: float) -> Array:
    """Noise (size,) of rms 1 through a first-order low-pass with time constant `lag` [s]."""
    keep = np.exp(-DT / lag)
    return np.asarray(lfilter([np.sqrt(1 - keep * keep)], [1.0, -keep], rng.normal(size=size)))


def _same_gusts(drive: Drive) -> Generator:
    """The gusts of a run are the same with and without noise."""
    return np.random.default_rng(int(drive.opened * 1e6))


def _number(drive: Drive) -> int:
    return int(drive.name[-1])


def _surface(rover: Rover, drive: Drive, t: Array) -> Array | float:
    """Share of the stiffness. Forms: "instant" in one run and from then on, "ramp", "later runs", "one run",
    "drift" over all runs, as tyres warm up."""
    s = rover.surroundings
    since = t - drive.begin - s.at
    if s.surface_form in ("instant", "ramp"):
        share = np.clip(since / RAMP, 0.0, 1.0) if s.surface_form == "ramp" else (since >= 0) * 1.0
        share = share if _number(drive) == s.run else np.full(t.size, float(_number(drive) > s.run))
    elif s.surface_form == "later runs":
        share = np.full(t.size, float(_number(drive) >= s.run))
    elif s.surface_form == "one run":
        share = np.full(t.size, float(_number(drive) == s.run))
    elif s.surface_form == "drift":
        share = 1.0 - np.exp(-(drive.opened - 50.0 + t) / WARMING)
    else:
        return 1.0
    return 1.0 - (1.0 - s.surface) * share


# ---- What the firmware logs of a motion: IMU through its low-pass, attitude and velocity of the EKF.

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


# ---- A run of a rover as the tool's `Recording`, in memory.

UNITS = {"r": "rad/s", "p": "rad/s", "ay": "m/s^2", "vy": "m/s", "speed": "m/s", "phi": "rad", "psi": "rad"}
OF_EKF = ("vy", "speed")


def driven(
    rover: Rover, drive: Drive, rng: Generator, noise: bool = True
) -> tuple[Array, Array, dict[str, Array]]:
    """(main loops (k,) [s], PWM (k,) [us], {channel: (steps,)}) of a run; noise: of road and sensors."""
    t_out, us = output_us(drive, rover, np.random.default_rng(int(drive.opened * 1e6)))
    start = np.zeros(STATES)
    start[5] = drive.heading
    ground = around(rover, drive, rng, noise)
    motion = integrated(command(drive, rover, t_out, us), wanted_speed(drive), ground, start, rover.numbers)
    return t_out, us, sensed(felt(motion, rover), rover.instruments, rng, noise)


def recorded(rover: Rover, drive: Drive, rng: Generator) -> Recording:
    """The run as the firmware logs it; time is since boot."""
    return logged(rover.instruments, drive, *driven(rover, drive, rng), "foreign plant")


def logged(
    i: Instruments, drive: Drive, t_out: Array, us: Array, x: Mapping[str, Array], firmware: str
) -> Recording:
    """A log of signals (steps,) before they are sampled. t_out, us (k,): main loops [s] and PWM [us]."""
    boot = round(drive.opened, 6)
    steps = np.minimum((t_out / DT).astype(int), x["r"].size - 1)
    every = max(1, round(i.loop_hz / i.ekf_hz))
    channels = {"pwm": Signal(t_out + boot, us, "us", "SWEP.Out at the main loop", hold=True)}
    for name, unit in UNITS.items():
        at = slice(None, None, every if name in OF_EKF else 1)
        channels[name] = Signal(t_out[at] + boot, x[name][steps][at], unit, name)
    throttle = np.where((t_out > STILL) & (t_out < drive.end), 1700.0, 1500.0)
    channels["throttle"] = Signal(t_out + boot, throttle, "us", "throttle", hold=True)
    gyro, accel = LowPass(i.gyro_hz, "INS_GYRO_FILTER"), LowPass(i.accel_hz, "INS_ACCEL_FILTER")
    digest = hashlib.sha256(channels["r"].x.tobytes()).hexdigest()
    begin, end = boot + drive.begin, boot + drive.end
    return Recording(
        drive.name,
        channels,
        (begin, end),
        drive.kind,
        standstill=((boot + 0.3, boot + STILL - 0.3), (end + BRAKING + 0.5, end + BRAKING + AFTER - 0.3)),
        straight=((begin - 1.0, begin + STRAIGHT), (end - STRAIGHT + 1.0, end)),
        filters={"r": gyro, "p": gyro, "ay": accel},
        firmware=firmware,
        sources=((f"{drive.name}.BIN", digest),),
    )


def runs_of(rover: Rover, plan: tuple[Drive, ...], seed: int) -> tuple[Runs, tuple[Recording, ...]]:
    """(runs to fit, held out) with their vehicle, as `rs.read` gives them."""
    vehicle = parse(vehicle_toml(rover.told))
    rng = np.random.default_rng(seed)
    found = tuple(with_delta(recorded(rover, drive, rng), vehicle) for drive in plan)
    return Runs(found[:3], vehicle), found[3:]
