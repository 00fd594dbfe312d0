"""How the drawn rovers are driven: steering [us] at the main loops and wanted speed, by five kinds of pilot.

By hand and in stop and go a stick moves at a finite rate; in a sweep the applet steers. In ACRO a turn rate
is wanted and in AUTO a mission is followed: there an autopilot closes the loop on the plant of tests/foreign,
with its own guesses of the rover. Other engines are then driven with the same steering.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import numpy as np
from numba import njit
from numpy.random import Generator
from scipy.ndimage import gaussian_filter1d

from tests.engines.engine import Array, EngineRover
from tests.foreign.plant import (
    DT,
    ROAD_ROLL,
    ROAD_Y,
    ROAD_YAW,
    STATES,
    STEERING_STATES,
    SURFACE,
    Numbers,
    derivative,
    steering_step,
)
from tests.foreign.recorded import ROAD_LAG, Drive, coloured, wave
from tests.recordings.rovers import LIMIT_US, NEUTRAL

LOOP = 20  # steps of DT in a main loop
LOOP_S = LOOP * DT
STILL_S = 4.0  # s of standing at the begin and at the end
MODES = {"by hand": "MANUAL", "stop and go": "MANUAL", "sweep": "MANUAL", "ACRO": "ACRO", "AUTO": "AUTO"}


@dataclass(frozen=True, eq=False)
class Piloted:
    """us (loops,) on the wire of a rover whose larger outputs turn right; wanted (steps,) m/s.

    stick: (loops,) us of the transmitter's steering. swept: (begin, end) [s] of each sweep of the applet.
    """

    kind: str
    us: Array
    wanted: Array
    stick: Array
    swept: tuple[tuple[float, float], ...] = ()

    @property
    def seconds(self) -> float:
        return float(self.wanted.size * DT)

    def command(self, rover: EngineRover) -> Array:
        """(steps,) rad, left positive: as the servo gets it after its delay."""
        steps = np.arange(self.wanted.size) - round(rover.delay / DT)
        at = np.clip(steps // LOOP, 0, self.us.size - 1)
        return -(self.us[at] - rover.trim_us) * rover.rad_per_us


def piloted(kind: str, rover: EngineRover, seconds: float, ground: Array, rng: Generator) -> Piloted:
    """The drive of this kind. ground (steps, 7): the road, as in `road`."""
    return PILOTS[kind](rover, seconds, ground, rng)


def road(rover: EngineRover, wanted_steps: int, rng: Generator) -> Array:
    """(steps, 7) surroundings of a drive in the columns of tests/foreign/plant: an uneven road."""
    n = rover.numbers
    out = np.zeros((wanted_steps, 7))
    out[:, SURFACE] = 1.0
    scales = (n.m, n.Izz, n.Ixx + n.ms * n.h**2)
    columns = (ROAD_Y, ROAD_YAW, ROAD_ROLL)
    for column, level, scale in zip(columns, rover.surroundings.road, scales, strict=True):
        out[:, column] = 0.8 * level * scale * coloured(rng, wanted_steps, ROAD_LAG)
    out[: round(STILL_S / DT)] *= 0.0
    out[: round(STILL_S / DT), SURFACE] = 1.0
    return out


# ---- Sticks.


def _plateaus(
    seconds: float, step: float, rng: Generator, low: float, high: float, draw: Callable[[], float]
):
    """(n,) of values that hold for low to high seconds each."""
    out, k = np.zeros(round(seconds / step)), 0
    while k < out.size:
        more = max(1, round(rng.uniform(low, high) / step))
        out[k : k + more] = draw()
        k += more
    return out


def _stick(rover: EngineRover, seconds: float, rng: Generator) -> Array:
    """(loops,) us about neutral: turns of all sizes, at the rate of a thumb."""
    large = rover.amplitude / rover.rad_per_us
    wanted = _plateaus(
        seconds, LOOP_S, rng, 0.3, 2.8, lambda: float(rng.choice([0, 1, 1]) * rng.normal(0, 0.5 * large))
    )
    step, at, out = rng.uniform(500, 1200) * LOOP_S, 0.0, np.zeros(wanted.size)
    for k, aim in enumerate(np.clip(wanted, -LIMIT_US, LIMIT_US).tolist()):
        at += min(max(aim - at, -step), step)
        out[k] = at
    return out


def _speed(rover: EngineRover, seconds: float, rng: Generator, stops: bool) -> Array:
    """(steps,) m/s wanted."""
    coarse = _plateaus(seconds, 0.1, rng, 8, 35, lambda: rover.speed * rng.uniform(0.4, 1.0))
    if stops:
        going = _plateaus(seconds, 0.1, rng, 3, 22, lambda: float(rng.uniform() < 0.7))
        coarse = coarse * going
    coarse = gaussian_filter1d(coarse, 4.0)
    coarse[: round(STILL_S / 0.1)] = 0.0
    coarse[-round(2 * STILL_S / 0.1) :] = 0.0
    t = np.arange(round(seconds / DT)) * DT
    found = np.interp(t, 0.1 * np.arange(coarse.size), coarse)
    return np.where(found < 0.15 * rover.speed, 0.0, found)


def _by_hand(rover: EngineRover, seconds: float, ground: Array, rng: Generator) -> Piloted:
    us = np.round(NEUTRAL + _stick(rover, seconds, rng))
    return Piloted("by hand", us, _speed(rover, seconds, rng, False), us)


def _stop_and_go(rover: EngineRover, seconds: float, ground: Array, rng: Generator) -> Piloted:
    us = np.round(NEUTRAL + _stick(rover, seconds, rng))
    return Piloted("stop and go", us, _speed(rover, seconds, rng, True), us)


def _sweep(rover: EngineRover, seconds: float, ground: Array, rng: Generator) -> Piloted:
    """Sweeps of the applet one after the other, of two amplitudes and two speeds."""
    loops, steps = round(seconds / LOOP_S), round(seconds / DT)
    us, wanted = np.zeros(loops), np.zeros(steps)
    large = rover.amplitude / rover.rad_per_us
    begin, k, swept = 0.0, 0, []
    while True:
        share, fast = ((0.5, 1.0), (1.0, 1.0), (0.7, 0.65))[k % 3]
        drive = Drive(f"run{k + 1}", "sweep", round(share * large), fast * rover.speed, 0.0, begin)
        if begin + drive.length > seconds + 1.0 and k:
            break
        t = np.arange(loops) * LOOP_S - begin
        inside = (t >= 0) & (t < drive.length)
        us[inside] = drive.amplitude * wave(drive, t[inside])
        s = np.arange(steps) * DT - begin
        wanted[(s > STILL_S) & (s < drive.end + 0.5)] = drive.speed
        swept.append((begin + drive.begin, begin + drive.end))
        begin, k = begin + drive.length, k + 1
    us = np.round(NEUTRAL + us)
    return Piloted("sweep", us, wanted, np.full(loops, NEUTRAL), tuple(swept))


# ---- An autopilot: a turn rate controller with its own guess of the rover, and a mission above it.

ACRO, AUTO = 0, 1
LOOK_AHEAD_S, ARRIVED = 1.6, 1.2  # s of driving, and shares of the way ahead from a waypoint


def _acro(rover: EngineRover, seconds: float, ground: Array, rng: Generator) -> Piloted:
    """The stick asks for turn rates."""
    top = 3.0 / rover.speed
    asked = _plateaus(
        seconds, LOOP_S, rng, 0.4, 3.0, lambda: float(rng.choice([0, 1, 1]) * rng.normal(0, 0.5 * top))
    )
    asked = gaussian_filter1d(asked, 3.0)
    wanted = _speed(rover, seconds, rng, False)
    us, wanted = _closed(rover, ACRO, asked, np.zeros((1, 2)), wanted, ground, rng)
    return Piloted("ACRO", us, wanted, np.round(NEUTRAL - 400 * np.clip(asked / top, -1, 1)))


def _auto(rover: EngineRover, seconds: float, ground: Array, rng: Generator) -> Piloted:
    """Waypoints a few look-aheads apart, at one speed, slower in the corners."""
    cruise = rover.speed * rng.uniform(0.6, 0.85)
    leg, place, course, points = cruise * LOOK_AHEAD_S, np.zeros(2), 0.0, []
    for _ in range(ceil(seconds / 3.0)):
        course += rng.choice([-1, 1]) * rng.uniform(0.5, 2.2)
        place = place + leg * rng.uniform(2.0, 5.0) * np.array([np.cos(course), np.sin(course)])
        points.append(place)
    wanted = np.full(round(seconds / DT), cruise)
    wanted[: round(STILL_S / DT)] = wanted[-round(2 * STILL_S / DT) :] = 0.0
    asked = np.zeros(round(seconds / LOOP_S))
    us, wanted = _closed(rover, AUTO, asked, np.array(points), wanted, ground, rng)
    return Piloted("AUTO", us, wanted, np.full(us.size, NEUTRAL))


def _closed(
    rover: EngineRover, mode: int, asked: Array, points: Array, wanted: Array, ground: Array, rng: Generator
) -> tuple[Array, Array]:
    """(us (loops,), wanted (steps,)) of the autopilot: feed-forward, P and I on the rate, as ATC_STR_RAT."""
    n = rover.numbers
    base = (n.a + n.b) * rng.uniform(0.8, 1.25)
    gains = np.array([base, base * rng.uniform(0.05, 0.35), base * rng.uniform(0.0, 0.4), rng.uniform(1, 6)])
    noise = 0.01 * rng.normal(size=asked.size)
    linkage = np.array([rover.rad_per_us, rover.trim_us, float(round(rover.delay / DT)), LIMIT_US, 3.2])
    return _autopilot(n, mode, asked, points, wanted.copy(), ground, gains, noise, linkage)


@njit(cache=True)
def _autopilot(
    n: Numbers, mode: int, asked: Array, points: Array, wanted: Array, ground: Array,
    gains: Array, noise: Array, linkage: Array,
) -> tuple[Array, Array]:  # fmt: skip
    loops = asked.size
    rad_per_us, trim, late, most, grip = linkage
    us = np.full(loops, 1500.0)
    x, servo = np.zeros(STATES), np.zeros(STEERING_STATES)
    one, two, middle = np.zeros(15), np.zeros(15), np.zeros(STATES)
    east = north = target = felt = total = delta = 0.0
    goal, cruise = 0, wanted.max()
    slow = np.zeros(loops)
    for k in range(loops):
        u = max(x[0], 0.3)
        want = asked[k]
        slow[k] = 1.0
        if mode == 1:
            ahead = LOOK_AHEAD_S * u
            dx, dy = points[goal, 0] - north, points[goal, 1] - east
            if dx * dx + dy * dy < (ARRIVED * ahead) ** 2 and goal < points.shape[0] - 1:
                goal += 1
                dx, dy = points[goal, 0] - north, points[goal, 1] - east
            off = (np.arctan2(dy, dx) - x[5] + np.pi) % (2 * np.pi) - np.pi
            off = min(max(off, -1.5), 1.5)
            want = 2 * u / ahead * np.sin(off)
            slow[k] = 1.0 - 0.4 * min(1.0, abs(off))
        want = min(max(want, -grip / u), grip / u)
        change = min(max(want - target, -gains[3] * 0.02), gains[3] * 0.02)
        target += change
        felt += 0.4 * (x[2] + noise[k] - felt)
        error = target - felt
        moving = x[0] > 0.3
        if moving:
            total = min(max(total + gains[2] * error * 0.02, -0.05), 0.05)
        angle = (gains[0] * target + gains[1] * error + total) / u if moving else 0.0
        us[k] = np.round(1500.0 - min(max(angle / rad_per_us, -most), most))
        for j in range(20):
            step = k * 20 + j
            if mode == 1 and wanted[step] > 0.0:
                wanted[step] = (
                    cruise * slow[k]
                    if k == 0
                    else wanted[step - 1] + 0.002 * (cruise * slow[k] - wanted[step - 1])
                )
            at = max(step - int(late), 0) // 20
            new = steering_step(servo, -(us[at] - trim) * rad_per_us, x[0], one[12], one[13], n, DT)
            derivative(x, delta, ground[step], wanted[step], n, one)
            for i in range(STATES):
                middle[i] = x[i] + DT * one[i]
            derivative(middle, new, ground[step], wanted[step], n, two)
            for i in range(STATES):
                x[i] += DT / 2 * (one[i] + two[i])
            north += DT * (x[0] * np.cos(x[5]) - x[1] * np.sin(x[5]))
            east += DT * (x[0] * np.sin(x[5]) + x[1] * np.cos(x[5]))
            delta = new
    return us, wanted


PILOTS = {"sweep": _sweep, "AUTO": _auto, "by hand": _by_hand, "ACRO": _acro, "stop and go": _stop_and_go}
