"""The runs of a set, and what steering and drive are told.

Sweep, sweep of twice the amplitude, sweep at another speed, doublets (held out).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tests.foreign.motion import DT
from tests.foreign.rover import Rover

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
