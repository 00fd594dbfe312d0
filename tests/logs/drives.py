"""Made-up logs in memory: a rover that answers steering at once."""

from __future__ import annotations

import numpy as np

from rover_sweep.data.recording import Array, Signal
from rover_sweep.logs.log import AppletRows, Log
from rover_sweep.manoeuvre.sweep import Manoeuvre


def signal(t: Array, x: Array, unit: str = "", hold: bool = False) -> Signal:
    return Signal(t, x, unit, f"MADE.{unit}", hold=hold)


def log_of(t: Array, pwm: Array, speed: Array, **more: object) -> Log:
    """A log whose yaw rate follows the steering; t (n,) s, pwm (n,) us, speed (n,) m/s."""
    r = -(pwm - 1500) * 0.004 * speed / 2
    signals = {
        "r": signal(t, r, "rad/s"),
        "p": signal(t, 0.1 * r, "rad/s"),
        "ay": signal(t, r * speed, "m/s^2"),
        "speed": signal(t, speed, "m/s"),
    }
    return Log(name="made", signals=signals, steering=(signal(t, pwm, "us", hold=True),), **more)  # type: ignore[arg-type]


def drive(manoeuvres: list[Manoeuvre], speed: float = 2.0, pause: float = 20.0) -> tuple[Log, list[float]]:
    """Standstill, all manoeuvres with straight driving in between, standstill; start [s] of each."""
    starts, at = [], 5.0 + pause
    for manoeuvre in manoeuvres:
        starts.append(at)
        at += manoeuvre.duration + pause
    t = np.arange(0.0, at + 5.0, 0.01)
    pwm = 1500 + sum(
        np.where((t >= s) & (t < s + m.duration), m.wave(t - s), 0.0)
        for s, m in zip(starts, manoeuvres, strict=True)
    )
    return log_of(t, np.round(pwm), np.where((t > 5) & (t < at), speed, 0.0)), starts


def applet_rows(t: Array, run: int, states: list[tuple[float, int]]) -> AppletRows:
    """Rows of one run: states as (time from which it holds [s], number)."""
    begins = np.array([b for b, _ in states])
    numbers = np.array([n for _, n in states], float)
    inside = t[(t >= begins[0]) & (t < begins[-1])]
    state = numbers[np.searchsorted(begins, inside, "right") - 1]
    return AppletRows(inside, np.full(inside.size, float(run)), state, inside - begins[0])
