"""A target turn rate that itself swings: how fast, and which loop of the firmware makes it.

The rate controller follows its target; where that target oscillates, the loop above it does. ArduRover 4.6.3:

- AUTO, RTL, SMART_RTL, GUIDED, DOCK, CIRCLE: `AR_PosControl` gives the turn rate (`Rover/mode.cpp`
  navigate_to_waypoint). Its velocity loop crosses over at PSC_VEL_P [1/s], its position loop at PSC_POS_P
  [1/s]. Before 4.2 it was the L1 controller: the period NAVL1_PERIOD [s].
- LOITER, FOLLOW, SIMPLE: calc_steering_to_heading, whose loop crosses over at ATC_STR_ANG_P [1/s].
- ACRO, STEERING: the pilot's stick.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import welch

from rover_sweep.data.recording import Array
from rover_sweep.gains.tracking import Even

LOWEST_HZ, HIGHEST_HZ = 0.08, 3.0
WINDOW, PERIODS = 40.0, 5  # s, of a spectrum; periods that a stretch needs
NARROW = 1.3  # factor from the middle to the ends of a line
LEAST_SHARE = 0.5  # of the target's power about its mean
ALTERNATES = 0.5  # share of the swing of the heading: the mean turn in one period is less
BY_POSITION = frozenset({8, 9, 10, 11, 12, 15})  # DOCK, CIRCLE, AUTO, RTL, SMART_RTL, GUIDED
BY_HEADING = frozenset({5, 6, 7})  # LOITER, FOLLOW, SIMPLE
BY_PILOT = frozenset({1, 3})  # ACRO, STEERING


@dataclass(frozen=True)
class SwingingTarget:
    """hz: of the swing; rms [rad/s]; share: of the target's power about its mean."""

    hz: float
    rms: float
    share: float


@dataclass(frozen=True)
class TargetLoop:
    """The loop that makes the target. name: for a sentence. parameters: of it, as this firmware names them,
    the one whose crossover is nearest to the swing first. value: what to set the first to, nan without one.
    """

    name: str
    parameters: tuple[str, ...]
    now: float = math.nan
    value: float = math.nan


def swinging_target(parts: Sequence[Even], least: float) -> SwingingTarget | None:
    """The line in the spectrum of the target, None without one. least: rms [rad/s].

    A turn of a mission that repeats, as round a square, goes on to one side: it is no swing.
    """
    if not parts:
        return None
    dt = parts[0].dt
    length = min(round(WINDOW / dt), max(part.target.size for part in parts))
    whole = [part for part in parts if part.target.size >= length]
    powers = [welch(part.target, fs=1 / dt, nperseg=length)[1] * part.target.size for part in whole]
    power: Array = np.sum(powers, axis=0) / sum(part.target.size for part in whole)
    w = np.arange(power.size) / (length * dt)
    inside = (w >= max(LOWEST_HZ, PERIODS / (length * dt))) & (w <= HIGHEST_HZ)
    if not inside.any() or not power.sum() > 0:
        return None
    hz = float(w[inside][np.argmax(power[inside])])
    band = (w >= hz / NARROW - w[1]) & (w <= hz * NARROW + w[1])
    rms, share = math.sqrt(float(power[band].sum()) * w[1]), float(power[band].sum() / power[1:].sum())
    mean = abs(float(np.mean(np.concatenate([part.target for part in whole]))))
    swung = math.sqrt(2) * rms / (math.pi * hz)  # of the heading, from end to end [rad]
    if share < LEAST_SHARE or rms < least or mean / hz > ALTERNATES * swung:
        return None
    return SwingingTarget(hz, rms, share)


def target_loop(mode: Array, parameters: Mapping[str, float], hz: float) -> TargetLoop | None:
    """The loop that makes the target in most of these rows; None for the pilot, or where it is not known.

    mode (n,): numbers; parameters: of the vehicle, by which this firmware is known.
    """
    if not mode.size:
        return None
    numbers, counts = np.unique(mode, return_counts=True)
    number = int(numbers[np.argmax(counts)])
    if number in BY_PILOT:
        return None
    if number in BY_HEADING:
        return _fastest("the heading controller", ("ATC_STR_ANG_P",), parameters, hz)
    if number not in BY_POSITION:
        return None
    if "NAVL1_PERIOD" in parameters and "PSC_POS_P" not in parameters:
        now = parameters["NAVL1_PERIOD"]
        others = ("NAVL1_PERIOD", "NAVL1_DAMPING")
        return TargetLoop("the L1 controller", others, now, float(f"{1.5 * now:.3g}"))
    return _fastest("the position controller", ("PSC_VEL_P", "PSC_POS_P"), parameters, hz)


def _fastest(name: str, gains: Sequence[str], parameters: Mapping[str, float], hz: float) -> TargetLoop:
    """The loop with its gains [1/s], the one nearest to the swing first; half of it is the next value."""
    known = {p: parameters[p] for p in gains if parameters.get(p, 0.0) > 0}
    ordered = sorted(known, key=lambda p: abs(math.log(known[p] / (2 * math.pi * hz))))
    if not ordered:
        return TargetLoop(name, tuple(gains))
    now = known[ordered[0]]
    return TargetLoop(name, tuple(ordered), now, float(f"{now / 2:.3g}"))
