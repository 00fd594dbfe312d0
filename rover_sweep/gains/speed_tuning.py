"""Design of the speed loop: base throttle from the law, P and I as fast as the worst of the family allows.

CRUISE_THROTTLE over CRUISE_SPEED gives the steady throttle without feedback at one speed. P and I minimise
the tracking error of steps of the commanded speed together with the error behind a slope, over all pairs
whose loop keeps 6 dB and 45 deg for the intervals of gain, lag and delay and for a battery 10 % up or down,
whose crossover lies where throttle and speed were coherent, which pass at most 5 % of noise to the throttle,
and whose predicted step overshoots by at most 5 %.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.recording import Array
from rover_sweep.gains.controller import feedback_response
from rover_sweep.gains.margins import GAIN_MARGIN_DB, PHASE_MARGIN_DEG, all_margins, frequencies, margins
from rover_sweep.gains.margins import Margins as LoopMargins
from rover_sweep.gains.speed_chain import SpeedLoop, SpeedSettings
from rover_sweep.gains.speed_identified import IdentifiedSpeed, SpeedPlant
from rover_sweep.gains.speed_simulation import SpeedDrive, simulate_speed

MOST_OVERSHOOT = 5.0  # percent
MOST_P, MOST_I = 2.0, 2.0  # ranges of the parameters (AR_AttitudeControl.cpp, var_info)
SLOWEST_INTEGRAL = 4.0  # lags that P / I may last: slower, the speed on a slope takes too long to recover
SPARED = 1.0  # percent above the least overshoot, where no pair keeps MOST_OVERSHOOT
MOST_NOISE = 0.05  # throttle rms, share of full, that P may make of the noise of the speed
RESERVE = 0.75  # share of the weaker of drive and drag that a planned change of speed may use
STEP_SECONDS, BEFORE = 8.0, 0.5
LEAST_DEAD_ZONE = 0.01  # share of full throttle
SLOPE = 0.3  # m/s^2: a slope of 3 %
_P = np.concatenate(([0.02], np.geomspace(0.04, MOST_P, 28)))
_I = np.geomspace(0.02, MOST_I, 26)


@dataclass(frozen=True)
class SpeedStep:
    """A predicted step of the commanded speed from `start` by `size` [m/s]: rise from 10 to 90 % [s];
    overshoot [% of size]; error: rms of limited target - speed [m/s]; behind: rms of commanded - speed
    [m/s]; throttle: largest of the controller, share of full."""

    start: float
    size: float
    rise: float
    overshoot: float
    error: float
    behind: float
    throttle: float


def step_of_speed(
    loop: SpeedLoop, plant: SpeedPlant, settings: SpeedSettings, start: float, size: float
) -> SpeedStep:
    """The predicted step with all limits of the firmware."""
    wanted, driven = driven_step(loop, plant, settings, start, size)
    return speed_step_metrics(
        driven.t, driven.target, driven.speed[:, 0], wanted, float(np.abs(driven.throttle).max())
    )


def driven_step(
    loop: SpeedLoop, plant: SpeedPlant, settings: SpeedSettings, start: float, size: float
) -> tuple[Array, SpeedDrive]:
    """Commanded speed (m,) [m/s] of a step, and the simulated drive with these settings."""
    wanted = step_wanted(loop, start, size)
    one = np.array([settings.p]), np.array([settings.i])
    return wanted, simulate_speed(loop, plant, settings, wanted, *one)


def speed_step_metrics(
    t: Array, target: Array, speed: Array, wanted: Array, throttle: float = np.nan
) -> SpeedStep:
    """The SpeedStep of a recorded or simulated step; wanted (m,) has its two speeds at its ends."""
    start, end = float(wanted[0]), float(wanted[-1])
    share = (speed - start) / (end - start)
    rise = _first(t, share, 0.9) - _first(t, share, 0.1)
    over = 100 * max(float(share.max()) - 1.0, 0.0)
    error, behind = (float(np.sqrt(np.mean((x - speed) ** 2))) for x in (target, wanted))
    return SpeedStep(start, end - start, rise, over, error, behind, throttle)


def _first(t: Array, share: Array, level: float) -> float:
    above = np.flatnonzero(share >= level)
    return float(t[above[0]]) if above.size else float("nan")


def step_wanted(loop: SpeedLoop, start: float, size: float) -> Array:
    """Commanded speed (m,) [m/s] of a step after `BEFORE` s, one value per main loop."""
    t = np.arange(round(STEP_SECONDS / loop.period)) * loop.period
    return np.where(t >= BEFORE, start + size, start)


def step_ends(found: IdentifiedSpeed) -> tuple[float, float]:
    """(start, size) [m/s]: the steps within the speeds that were swept, about their mean."""
    low, mean, high = found.speeds
    half = 0.7 * min(mean - low, high - mean)
    return mean - half, 2 * half


def margins_of(loop: SpeedLoop, plants: list[SpeedPlant], settings: SpeedSettings) -> list[LoopMargins]:
    """Margins of each plant."""
    w = frequencies(loop.period)
    shared = replace(loop.filters, d=settings.d)
    feedback = feedback_response(shared, np.array([settings.p]), np.array([settings.i]), loop.period, w)[0]
    scale = 1.0 - loop.least
    return [margins(feedback * plant.response(w, loop.period) * scale, w) for plant in plants]


def cruise(loop: SpeedLoop, plant: SpeedPlant, speed: float) -> tuple[float, float]:
    """(CRUISE_SPEED [m/s], CRUISE_THROTTLE [%]): the whole percent next to the speed, and its exact speed."""
    percent = float(np.clip(round(100 * loop.from_motor(plant.offset + speed / plant.gain)), 5, 100))
    return round(plant.gain * (loop.at_motor(percent / 100) - plant.offset), 2), percent


def without_dead_zone(loop: SpeedLoop, found: IdentifiedSpeed) -> SpeedLoop:
    """The loop with MOT_THR_MIN at the dead zone, in whole percent, where that is certain and not yet left
    out.

    The base throttle then fits at all speeds, not at one.
    """
    assert found.plant is not None
    percent = int(100 * found.plant.dead_zone)
    certain = found.dead_zone_from > LEAST_DEAD_ZONE and percent / 100 > loop.least
    return replace(loop, least=percent / 100) if certain else loop


def accel_limit(loop: SpeedLoop, found: IdentifiedSpeed) -> float:
    """ATC_ACCEL_MAX [m/s^2]: three quarters of what drive (at the highest speed of the runs) and drag (at the
    lowest, motor at neutral) can do, at least 0.1."""
    plant = found.plant
    assert plant is not None
    low, _, high = found.speeds
    up = (plant.gain * (loop.most - plant.offset) - high) / plant.lag
    down = (low + plant.gain * (plant.offset - plant.dead_zone)) / plant.lag
    if found.coasting is not None:
        down = found.coasting[0] + (low - found.coasting[1]) / plant.lag
    return float(max(np.floor(10 * RESERVE * min(up, down)) / 10, 0.1))


def design_speed(loop: SpeedLoop, found: IdentifiedSpeed) -> SpeedSettings | None:
    """The best settings; None if no pair of P and I keeps the margins.

    Where no pair keeps 5 % overshoot, that of about the least.
    """
    plant = found.plant
    assert plant is not None
    at, percent = cruise(loop, plant, found.speeds[1])
    settings = SpeedSettings(at, percent, 0.0, 0.0, 0.0, accel_limit(loop, found))
    p, i = (grid.ravel() for grid in np.meshgrid(_P, _I))
    offered = (p * found.residual <= MOST_NOISE) & (p <= SLOWEST_INTEGRAL * plant.lag * i)
    p, i = p[offered], i[offered]
    keeps = _robust(loop, found, p, i)
    p, i = p[keeps], i[keeps]
    if p.size == 0:
        return None
    start, size = step_ends(found)
    wanted = step_wanted(loop, start, size)
    driven = simulate_speed(loop, plant, settings, wanted, p, i)
    over = 100 * ((driven.speed.max(axis=0) - start) / size - 1.0)
    damped = over <= max(MOST_OVERSHOOT, float(over.min()) + SPARED)
    p, i = p[damped], i[damped]
    tracking = np.sqrt(np.mean((driven.target[:, None] - driven.speed[:, damped]) ** 2, axis=0))
    level = np.full(wanted.size, found.speeds[1])
    pushed = simulate_speed(loop, plant, settings, level, p, i, np.where(wanted > start, -SLOPE, 0.0))
    sagging = np.sqrt(np.mean((level[:, None] - pushed.speed) ** 2, axis=0))
    best = int(np.argmin(tracking + sagging))
    return replace(settings, p=_rounded_down(p[best]), i=_rounded_down(i[best]))


def _robust(loop: SpeedLoop, found: IdentifiedSpeed, p: Array, i: Array) -> np.ndarray:
    """Mask (n,) of the pairs that keep both margins for the whole family, with a coherent crossover."""
    keeps = np.ones(p.size, dtype=bool)
    w = frequencies(loop.period)
    for plant in found.family():
        left = np.flatnonzero(keeps)
        if left.size == 0:
            break
        feedback = feedback_response(loop.filters, p[left], i[left], loop.period, w)
        response = plant.response(w, loop.period) * (1.0 - loop.least)
        gain, phase, crossover, _ = all_margins(feedback * response, w)
        keeps[left] = (gain >= GAIN_MARGIN_DB) & (phase >= PHASE_MARGIN_DEG)
        if found.band is not None and plant == found.plant:
            keeps[left] &= ~(crossover > found.band[1])
    return keeps


def _rounded_down(value: float) -> float:
    """Rounded down to three decimals, so that rounding never reduces a margin."""
    return float(np.floor(value * 1000) / 1000)
