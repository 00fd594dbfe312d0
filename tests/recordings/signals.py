"""What the instruments make of a drive, before it is logged: the signals that every logging profile samples.

Filters, noise and estimator are those of tests/foreign. Faults of sensors change these signals; faults of the
recording change the stamps, the gaps or the names.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.random import Generator
from scipy.ndimage import uniform_filter1d

from tests.engines.engine import Array, EngineRover, Signals
from tests.foreign.plant import DT, GRAVITY
from tests.foreign.recorded import sensed
from tests.recordings.pilots import LOOP, MODES, NEUTRAL, Piloted

BOOT_S = 12.0  # s of the autopilot's clock when the log begins
GPS_LATE_S, GPS_NOISE = 0.12, 0.05  # s, m/s
REPEATED, REPEATED_SHARE = "repeated rows", 0.04  # flag: that share of the messages is written twice


@dataclass(frozen=True, eq=False)
class Recorded:
    """A drive as its instruments have it, ISO axes, SI units, all (steps,) at 1 kHz from `BOOT_S` on.

    x: us (steering output), stick, throttle (us), r, p, ax, ay, az, phi, psi, north, west (EKF velocity,
    m/s), ground (GPS speed), course (GPS, left positive), wheel (encoder, m/s), angle (of the wheels, rad),
    command (the angle that is asked for, rad), x, y (m).
    holes: (begin, end) s in which nothing is logged; lost: share of messages that are lost besides. late:
    {group of signals: s} by which the stamps of a group are late. names: {column: the name it is given}.
    units: {column: factor that its values carry and its unit does not say}. parameters: of the autopilot.
    """

    piloted: Piloted
    x: Mapping[str, Array]
    parameters: Mapping[str, float]
    holes: tuple[tuple[float, float], ...] = ()
    lost: float = 0.0
    late: Mapping[str, float] = field(default_factory=dict)
    names: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, float] = field(default_factory=dict)
    flags: frozenset[str] = frozenset()

    def having(self, **x: Array) -> Recorded:
        """With other signals."""
        return replace(self, x={**self.x, **x})

    @property
    def mode(self) -> str:
        return MODES[self.piloted.kind]

    def rows(self, hz: float, rng: Generator) -> Array:
        """(n,) steps at which a stream of this rate is logged, without those that are lost."""
        every = 1 / (hz * DT)
        at = np.round(np.arange(self.x["r"].size / every) * every).astype(int)
        at = at[at < self.x["r"].size]
        keep = np.ones(at.size, bool)
        for begin, end in self.holes:
            keep &= (at * DT < begin) | (at * DT > end)
        if self.lost:
            keep &= rng.uniform(size=at.size) > self.lost
        at = at[keep]
        if REPEATED in self.flags:
            at = np.sort(np.concatenate((at, at[rng.uniform(size=at.size) < REPEATED_SHARE])))
        return np.asarray(at)

    def half(self, second: bool) -> Recorded:
        """The first or the second half, as a log of its own."""
        middle = self.x["r"].size // (2 * LOOP) * LOOP
        part = slice(middle, None) if second else slice(None, middle)
        piloted = replace(self.piloted, wanted=self.piloted.wanted[part], swept=())
        return replace(self, piloted=piloted, x={name: x[part] for name, x in self.x.items()})


def instrumented(
    rover: EngineRover, piloted: Piloted, motion: Signals, mirrored: bool, rng: Generator
) -> Recorded:
    """The drive behind sensors, filters and estimator. mirrored: larger outputs turn left."""
    i = rover.instruments
    found = sensed(motion, i, rng)
    speed, psi = motion["speed"], motion["psi"]
    toward = found["speed"] + 1j * found["vy"]
    ground = toward * np.exp(1j * found["psi"])
    true = (speed + 1j * motion["vy"]) * np.exp(1j * psi)
    late = np.concatenate((np.zeros(round(GPS_LATE_S / DT)), true))[: true.size]
    noise = rng.normal(size=true.size) + 1j * rng.normal(size=true.size)
    gps = late + GPS_NOISE * _held(noise, 200)
    place = np.cumsum(true) * DT
    us = np.repeat(piloted.us, LOOP)[: speed.size]
    stick = np.repeat(piloted.stick, LOOP)[: speed.size]
    command = -(us - NEUTRAL) * rover.rad_per_us
    vibration = i.accel_noise * rng.normal(size=(2, speed.size))
    throttle = NEUTRAL + np.where(piloted.wanted != 0, 80 + 50 * piloted.wanted, 0.0)
    signals = {
        "us": 2 * NEUTRAL - us if mirrored else us,
        "stick": stick,
        "throttle": np.round(throttle),
        **{name: found[name] for name in ("r", "p", "ay", "phi", "psi")},
        "ax": uniform_filter1d(np.gradient(found["speed"], DT) + vibration[0], 30),
        "az": GRAVITY + uniform_filter1d(vibration[1], 30),
        "north": ground.real,
        "west": ground.imag,
        "ground": np.abs(gps),
        "course": np.unwrap(np.angle(gps)),
        "wheel": speed * (1 + rng.uniform(-0.01, 0.01)) + 0.01 * rng.normal(size=speed.size),
        "command": command,
        "angle": _servo(command, rover) - (NEUTRAL - rover.trim_us) * rover.rad_per_us,
        "x": place.real,
        "y": place.imag,
    }
    parameters = {
        "SERVO1_FUNCTION": 26, "SERVO1_MIN": 1100, "SERVO1_MAX": 1900, "SERVO1_TRIM": 1500,
        "SERVO1_REVERSED": float(mirrored), "SERVO3_FUNCTION": 70, "SERVO3_MIN": 1100, "SERVO3_MAX": 1900,
        "SERVO3_TRIM": 1500, "RCMAP_ROLL": 1, "RCMAP_THROTTLE": 3, "RC1_REVERSED": 0, "SCHED_LOOP_RATE": 50,
        "INS_GYRO_FILTER": i.gyro_hz, "INS_ACCEL_FILTER": i.accel_hz, "LOG_BITMASK": 65535,
        "MOT_SPD_SCA_BASE": 1.0, "AHRS_ORIENTATION": 0,
    }  # fmt: skip
    return Recorded(piloted, signals, parameters)


def _held(x: Array, steps: int) -> Array:
    return np.asarray(np.repeat(x[::steps], steps)[: x.size])


def _servo(command: Array, rover: EngineRover) -> Array:
    """The wheels' angle (steps,) about their middle, of the servo's delay and lag."""
    from scipy.signal import lfilter

    n, late = rover.numbers, round(rover.delay / DT)
    delayed = np.concatenate((np.full(late, command[0]), command))[: command.size]
    # w' = (gain e - w) / motor_lag and angle' = w, as transfer function of the steps
    gain, motor = n.gain * DT, DT / n.motor_lag
    top = [0.0, 0.0, gain * motor]
    bottom = [1.0, motor - 2.0, 1.0 - motor + gain * motor]
    return np.asarray(lfilter(top, bottom, delayed))
