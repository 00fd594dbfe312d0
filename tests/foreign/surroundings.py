"""Road, wind, surface and load along a run, on the steps of the integrator."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.signal import lfilter

from tests.foreign.chassis import ROAD_ROLL, ROAD_Y, ROAD_YAW, SHIFT, SURFACE, WIND_X, WIND_Y
from tests.foreign.drive import STILL, Drive
from tests.foreign.motion import DT
from tests.foreign.rover import Rover

Array = NDArray[np.float64]
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
