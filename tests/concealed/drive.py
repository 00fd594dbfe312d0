"""The test plan of a set and the applet's hand: states, the wave of the paper's sweep law, the servo PWM."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tests.concealed.rover import GRAVITY, Rng, Rover, cruise_speed

Array = NDArray[np.float64]

W_MIN, W_MAX, T_REC, FADE, DWELL = 0.5, 25.0, 55.0, 2.0, 2.0  # rad/s, rad/s, s, s, s
C1, C2 = 4.0, 0.0187  # Tischler & Remple's law
PULSE, PAUSE, COUNT = 1.0, 2.0, 3  # s, s, doublets


@dataclass(frozen=True)
class Drive:
    """One run: amplitude [us], speed [m/s], heading at the start [rad, left of north], stretches [s]."""

    name: str
    kind: Literal["sweep", "doublet"]
    amplitude_us: float
    speed: float
    heading: float
    number: int
    parked: float
    still: float
    run_up: float
    straight: float
    still_after: float
    boot: float

    @property
    def start(self) -> float:
        """Where the override begins (state 3), s from the opening of the log."""
        return self.parked + self.still + self.run_up

    @property
    def wave_length(self) -> float:
        return FADE + DWELL + T_REC + FADE if self.kind == "sweep" else COUNT * (2 * PULSE + PAUSE)

    @property
    def stop(self) -> float:
        """Where the override ends and the pilot brakes, s."""
        return self.start + 2 * self.straight + self.wave_length

    @property
    def length(self) -> float:
        return self.stop + 2.5 + self.still_after


def draw_plan(rng: Rng, rover: Rover) -> tuple[Drive, ...]:
    """run1 sweep at A1, run2 at 2 A1, run3 another speed, run4 doublets (held out); headings all over."""
    speed = cruise_speed(rover, rng.uniform(0.88, 1.12))
    base = rover.a + rover.b
    understeer = rover.m * (rover.b * rover.cr - rover.a * rover.cf) / (base**2 * rover.cf * rover.cr)
    gain = speed**2 / (base * (1 + understeer * speed**2))  # steady a_y per rad
    peak = rng.uniform(0.3, 0.4) * GRAVITY / gain / rover.rad_per_us
    large = 2 * round(min(peak, 0.26 / rover.rad_per_us) / 2)
    second = speed * rng.uniform(0.62, 0.75)
    boot, headings = rng.uniform(35.0, 60.0), rng.uniform(-np.pi, np.pi) + np.array([0.0, 1.9, 3.6, 5.0])
    rows = [
        ("run1", "sweep", large / 2, speed),
        ("run2", "sweep", large, speed),
        ("run3", "sweep", round(0.7 * large), second),
        ("run4", "doublet", round(0.6 * large), speed),
    ]
    drives = []
    for k, (name, kind, amplitude, v) in enumerate(rows):
        drive = Drive(
            name,
            kind,
            float(amplitude),
            float(v),
            float(headings[k]),
            k + 1,  # type: ignore[arg-type]
            parked=rng.uniform(1.0, 2.0),
            still=rng.uniform(4.0, 5.0),
            run_up=rng.uniform(4.5, 5.5),
            straight=rng.uniform(3.5, 4.5),
            still_after=rng.uniform(6.0, 8.0),
            boot=float(boot),
        )
        drives.append(drive)
        boot += drive.length + rng.uniform(20.0, 40.0)
    return tuple(drives)


def wave(drive: Drive, t: Array) -> Array:
    """Commanded PWM off trim [us] at times t [s] from the start of the wave; positive as PWM."""
    unit = _sweep(t) if drive.kind == "sweep" else _doublets(t)
    return drive.amplitude_us * unit


def _sweep(t: Array) -> Array:
    inside = np.clip(t - FADE - DWELL, 0.0, T_REC)
    after = np.clip(t - FADE - DWELL - T_REC, 0.0, FADE)
    span = W_MAX - W_MIN
    law = W_MIN * inside + span * C2 * (T_REC / C1 * np.expm1(C1 * inside / T_REC) - inside)
    last = W_MIN + C2 * np.expm1(C1) * span
    phase = W_MIN * np.clip(t, 0.0, FADE + DWELL) + law + last * after
    window = np.clip(t / FADE, 0.0, 1.0) * (1 - after / FADE)
    return window * np.sin(phase) * (t < FADE + DWELL + T_REC + FADE)


def _doublets(t: Array) -> Array:
    within = np.mod(t, 2 * PULSE + PAUSE)
    sign = np.where(np.floor(t / (2 * PULSE + PAUSE)) % 2 == 0, 1.0, -1.0)
    unit = np.where(within < PULSE, 1.0, np.where(within < 2 * PULSE, -1.0, 0.0))
    return np.where((t >= 0) & (t < COUNT * (2 * PULSE + PAUSE)), sign * unit, 0.0)


def states(drive: Drive, t: Array) -> NDArray[np.int64]:
    """State of the applet at log times t [s]: 0 idle, 1 still, 2 waiting, 3 straight .. 9 still after."""
    w = drive.start + drive.straight
    if drive.kind == "sweep":
        edges = [
            drive.parked,
            drive.parked + drive.still,
            drive.start,
            w,
            w + FADE,
            w + FADE + DWELL,
            w + FADE + DWELL + T_REC,
            w + drive.wave_length,
            drive.stop,
        ]
        names = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]
    else:
        edges = [drive.parked, drive.parked + drive.still, drive.start, w, w + drive.wave_length, drive.stop]
        names = [0, 1, 2, 3, 6, 8, 9]
    return np.array(names)[np.searchsorted(edges, t, "right")]


@dataclass(frozen=True, eq=False)
class Steering:
    """What the applet did: t [s] of its turns, state, T [s], cmd [us] wanted, out [us] put out (whole)."""

    t: Array
    state: NDArray[np.int64]
    clock: Array
    cmd: Array
    out: Array


def steer(drive: Drive, rng: Rng) -> Steering:
    """Turns 12 to 35 ms apart, as the Lua thread gets them; the PWM holds between two of them."""
    n = int(drive.length / 0.012)
    gaps = 0.0125 + rng.choice([0.0, 0.0, 0.0025, 0.005, 0.0075], n) + rng.exponential(0.0015, n)
    t = drive.parked + np.cumsum(np.minimum(gaps, 0.035))
    t = np.round(t[t < drive.stop + 2.5 + 0.6 * drive.still_after] * 1e6) / 1e6
    clock = np.where(t >= drive.start, np.minimum(t, drive.stop) - drive.start, 0.0)
    cmd = 1500.0 + np.where((t >= drive.start) & (t < drive.stop), wave(drive, clock - drive.straight), 0.0)
    return Steering(t, states(drive, t), clock, cmd, np.round(cmd))
