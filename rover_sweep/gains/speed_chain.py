"""ArduRover's speed loop from commanded speed to throttle, and its parameters.

Source: ArduRover 4.6.3 (tag Rover-4.6.3):

- `Rover/mode.cpp` calc_throttle calls `AR_AttitudeControl::get_throttle_out_speed` in every main loop: the
  desired speed changes by at most ATC_ACCEL_MAX (ATC_DECEL_MAX when slowing down, if that is set), then
  AC_PID on (desired, EKF forward speed) plus ATC_SPEED_FF, plus the base throttle desired * CRUISE_THROTTLE /
  CRUISE_SPEED. Below zero the output brakes or reverses if ATC_BRAKE is 1, else it is 0.
- `libraries/AR_Motors/AP_MotorsUGV.cpp` slew_limit_throttle: the throttle changes by at most MOT_SLEWRATE
  %/s; get_scaled_throttle: MOT_THR_MIN + (100 - MOT_THR_MIN)/100 * throttle, so a dead zone is left out;
  then +-MOT_THR_MAX. The limit flags stop the integrator from growing.
- `libraries/SRV_Channel`: 100 % is SERVOn_MAX, 0 SERVOn_TRIM, straight between.
- CRUISE_THROTTLE is a whole number. CRUISE_SPEED is also the speed of missions unless WP_SPEED is set.
- Defaults: AR_ATTCONTROL_THR_* in AR_AttitudeControl.cpp. The error filter is ATC_SPEED_FLTE, 10 Hz.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.gains.controller import RatePid, feedback_response
from rover_sweep.gains.steering_chain import Gains
from rover_sweep.gains.tuning import (
    MOST_I,
    MOST_OVERSHOOT,
    MOST_P,
    Margins,
    frequencies,
    margins,
    robust,
    rounded_down,
)

Throttle = TypeVar("Throttle", float, Array)

SPEED_DEFAULTS: Mapping[str, float] = {
    "CRUISE_SPEED": 2.0,
    "CRUISE_THROTTLE": 50.0,
    "ATC_SPEED_P": 0.2,
    "ATC_SPEED_I": 0.2,
    "ATC_SPEED_D": 0.0,
    "ATC_SPEED_IMAX": 1.0,
    "ATC_SPEED_FF": 0.0,
    "ATC_SPEED_FLTT": 0.0,
    "ATC_SPEED_FLTE": 10.0,
    "ATC_SPEED_FLTD": 0.0,
    "ATC_SPEED_D_FF": 0.0,
    "ATC_ACCEL_MAX": 1.0,
    "ATC_DECEL_MAX": 0.0,
    "ATC_BRAKE": 1.0,
    "MOT_THR_MIN": 0.0,
    "MOT_THR_MAX": 100.0,
    "MOT_SLEWRATE": 100.0,
    "MOT_THST_EXPO": 0.0,
    "SCHED_LOOP_RATE": 50.0,
}
"""Defaults of ArduRover 4.6.3."""


@dataclass(frozen=True)
class SpeedSettings:
    """Proposed settings. cruise_speed [m/s], cruise_throttle [%]; p, d, i: of the speed PID, to a throttle of
    -1..1; accel_max [m/s^2], 0 for no limit."""

    cruise_speed: float
    cruise_throttle: float
    p: float
    i: float
    d: float
    accel_max: float

    @property
    def parameters(self) -> dict[str, float]:
        """By the firmware's parameter names."""
        return {
            "CRUISE_SPEED": self.cruise_speed,
            "CRUISE_THROTTLE": self.cruise_throttle,
            "ATC_SPEED_P": self.p,
            "ATC_SPEED_I": self.i,
            "ATC_SPEED_D": self.d,
            "ATC_ACCEL_MAX": self.accel_max,
        }


@dataclass(frozen=True)
class SpeedLoop:
    """The loop around the speed controller. filters: low-passes and IMAX in `Gains`; loop_hz: main loop.

    decel_max [m/s^2], 0 for accel_max; brakes: ATC_BRAKE; least, most: MOT_THR_MIN, MOT_THR_MAX as shares;
    slew: of the throttle [1/s], 0 for none. assumed: parameters that were not given.
    """

    now: SpeedSettings
    filters: Gains
    loop_hz: float
    decel_max: float = 0.0
    brakes: bool = True
    least: float = 0.0
    most: float = 1.0
    slew: float = 1.0
    assumed: tuple[str, ...] = ()
    not_modelled: Mapping[str, float] = field(default_factory=dict)

    @property
    def period(self) -> float:
        """Period of the main loop, s."""
        return 1.0 / self.loop_hz

    def at_motor(self, throttle: Throttle) -> Throttle:
        """Motor throttle for a positive controller throttle (or an array), both 0..1."""
        return self.least + (1.0 - self.least) * throttle

    def from_motor(self, throttle: float) -> float:
        """Throttle of the controller for one at the motor."""
        return (throttle - self.least) / (1.0 - self.least)

    def base(self, settings: SpeedSettings) -> float:
        """Throttle per speed [1/(m/s)] without feedback."""
        if settings.cruise_speed <= 0 or settings.cruise_throttle <= 0:
            return self.filters.ff
        return self.filters.ff + settings.cruise_throttle / 100 / settings.cruise_speed


def speed_loop(parameters: Mapping[str, float], assumed: Mapping[str, float] | None = None) -> SpeedLoop:
    """The loop from the autopilot's parameters by name. assumed: values to use before the defaults.

    Raises ValueError for an impossible loop rate or throttle range.
    """
    filled = {n: float(f"{v:.7g}") for n, v in {**SPEED_DEFAULTS, **(assumed or {}), **parameters}.items()}
    if not (filled["SCHED_LOOP_RATE"] > 0 and 0 <= filled["MOT_THR_MIN"] < filled["MOT_THR_MAX"] <= 100):
        raise ValueError(
            f"SCHED_LOOP_RATE {filled['SCHED_LOOP_RATE']:g} Hz, MOT_THR_MIN {filled['MOT_THR_MIN']:g} and "
            f"MOT_THR_MAX {filled['MOT_THR_MAX']:g} % are not possible; check these parameters"
        )
    pid = {k.removeprefix("ATC_SPEED_"): v for k, v in filled.items() if k.startswith("ATC_SPEED_")}
    now = SpeedSettings(
        filled["CRUISE_SPEED"],
        filled["CRUISE_THROTTLE"],
        pid["P"],
        pid["I"],
        pid["D"],
        filled["ATC_ACCEL_MAX"],
    )
    filters = Gains(pid["FF"], 0.0, 0.0, 0.0, pid["IMAX"], pid["FLTT"], pid["FLTE"], pid["FLTD"], pid["D_FF"])
    return SpeedLoop(
        now,
        filters,
        filled["SCHED_LOOP_RATE"],
        max(filled["ATC_DECEL_MAX"], 0.0),
        bool(filled["ATC_BRAKE"]),
        filled["MOT_THR_MIN"] / 100,
        filled["MOT_THR_MAX"] / 100,
        max(filled["MOT_SLEWRATE"], 0.0) / 100,
        tuple(name for name in SPEED_DEFAULTS if name not in parameters),
        {n: filled[n] for n in ("MOT_THST_EXPO", "ATC_SPEED_D_FF") if filled[n]},
    )


# Input of the speed gains: the law of the speed as `speed.json` holds it.


BATTERY = 0.1  # relative change of the gain between a full and an empty battery, either way


@dataclass(frozen=True)
class SpeedPlant:
    """T v' = K (u(t - tau) - u0) - v: gain [m/s per full throttle], lag, delay [s], offset (share of full),
    of which dead_zone is the motor controller's and the rest is drag."""

    gain: float
    lag: float
    delay: float
    offset: float
    dead_zone: float = 0.0

    def response(self, w: Array, period: float) -> NDArray[np.complex128]:
        """Frequency response (n,) at w (n,) rad/s of the plant behind a throttle held for a period [s]."""
        z, a = np.exp(1j * w * period), np.exp(-period / self.lag)
        return np.asarray(self.gain * (1 - a) / (z - a) * np.exp(-1j * w * self.delay))


@dataclass(frozen=True)
class IdentifiedSpeed:
    """plant; intervals: 90 % {name: (low, high)}; level, reasons: verdict of the identification; speeds:
    (lowest, mean, highest) [m/s]; band: usable [rad/s]; residual: of the speed [m/s rms]; coasting:
    deceleration at neutral [m/s^2] and the speed there [m/s], None if not recorded; parameters: of
    the autopilot in the runs; dead_zone_from: lower end of its interval (share of full), 0 if unknown."""

    plant: SpeedPlant | None
    intervals: Mapping[str, tuple[float, float]]
    level: str
    reasons: tuple[str, ...]
    speeds: tuple[float, float, float]
    band: tuple[float, float] | None
    residual: float
    coasting: tuple[float, float] | None
    parameters: Mapping[str, float]
    dead_zone_from: float = 0.0

    def family(self) -> Iterator[SpeedPlant]:
        """The plant, and the corners of the intervals of gain (with the battery's state), lag and delay."""
        assert self.plant is not None
        yield self.plant
        gain, lag, delay = (self.intervals[name] for name in ("gain", "lag", "delay"))
        gains = (gain[0] * (1 - BATTERY), gain[1] * (1 + BATTERY))
        for k, t, tau in itertools.product(gains, lag, delay):
            yield replace(self.plant, gain=k, lag=t, delay=tau)


def speed_from_document(document: Mapping[str, Any]) -> IdentifiedSpeed:
    """From the document of speed.json; KeyError, TypeError or ValueError for a damaged one."""
    law, coasting = document["law"], document["coasting"]
    plant = None
    if law is not None:
        zone = (coasting or {}).get("dead_zone")
        offset = float(law["offset"])
        kept = min(max(float(zone), 0.0), max(offset, 0.0)) if zone is not None else 0.0
        plant = SpeedPlant(float(law["gain_m_s"]), float(law["lag_s"]), float(law["delay_s"]), offset, kept)
    low, mean, high = document["speeds_m_s"]
    return IdentifiedSpeed(
        plant,
        {name: (float(ends[0]), float(ends[1])) for name, ends in document["intervals"].items()},
        str(document["level"]),
        tuple(document["reasons"]),
        (float(low), float(mean), float(high)),
        tuple(document["band_rad_s"]) if document["band_rad_s"] else None,
        float(document["residual_m_s"] or 0.0),
        (float(coasting["deceleration_m_s2"]), float(coasting["speed_m_s"])) if coasting else None,
        {name: float(value) for name, value in document["parameters"].items()},
        float(((coasting or {}).get("dead_zone_interval") or (0.0,))[0]),
    )


# Simulates ArduRover's speed loop around the identified law, for many controllers in parallel.


@dataclass(frozen=True, eq=False)
class SpeedDrive:
    """t (m,) [s]; target (m,) [m/s] after the limit of the acceleration; speed (m, n) [m/s]; throttle (m, n)
    of the controller, -1..1."""

    t: Array
    target: Array
    speed: Array
    throttle: Array


def accelerated(loop: SpeedLoop, accel_max: float, wanted: Array) -> Array:
    """The target (m,) [m/s] for a commanded speed (m,), one value per main loop; starts at the first."""
    out, now = np.empty_like(wanted), float(wanted[0])
    for k, want in enumerate(wanted):
        slower = abs(want) < abs(now) and loop.decel_max > 0
        step = (loop.decel_max if slower else accel_max) * loop.period
        now = out[k] = want if accel_max <= 0 else min(max(want, now - step), now + step)
    return out


def simulate_speed(
    loop: SpeedLoop,
    plant: SpeedPlant,
    settings: SpeedSettings,
    wanted: Array,
    p: Array,
    i: Array,
    push: Array | None = None,
) -> SpeedDrive:
    """The loop from a steady drive at wanted[0] [m/s], for n controllers p, i (n,).

    wanted (m,): commanded speed in each main loop. push (m,): acceleration by a slope [m/s^2].
    """
    dt, n = loop.period, p.size
    ff = np.full(n, loop.base(settings))
    pid = RatePid(replace(loop.filters, d=settings.d), dt, p, i, ff)
    target = accelerated(loop, settings.accel_max, wanted)
    decay = float(np.exp(-dt / plant.lag))
    steps = int(plant.delay / dt)
    start = float(target[0])
    held = loop.from_motor(plant.offset + start / plant.gain)
    pid.integrator = np.where(i > 0, held - ff * start, 0.0)
    # without I, the speed settles where P and the base throttle balance the law
    slope = (1 - loop.least) * plant.gain
    free = (slope * (ff + p) * start + plant.gain * (loop.least - plant.offset)) / (1 + slope * p)
    v = np.where(i > 0, start, free)
    sent = np.full(n, held)
    speed, throttle = np.empty((wanted.size, n)), np.empty((wanted.size, n))
    limit, motor = np.zeros(n, dtype=bool), np.empty((wanted.size, n))
    for k, at in enumerate(target):
        speed[k] = v
        out = pid.update(float(at), v, limit)
        out = out if loop.brakes else np.maximum(out, 0.0)
        most = loop.slew * dt if loop.slew > 0 else np.inf
        slewed = np.clip(np.clip(out, sent - most, sent + most), -1.0, 1.0)
        limit, sent = slewed != out, slewed
        throttle[k] = sent
        motor[k] = np.clip(np.sign(sent) * loop.at_motor(np.abs(sent)), -loop.most, loop.most)
        felt = motor[max(k - steps, 0)]
        drive = np.sign(felt) * np.maximum(np.abs(felt) - plant.dead_zone, 0.0)
        pulled = plant.gain * (drive - (plant.offset - plant.dead_zone) * np.sign(v + 1e-9))
        pulled = pulled + (plant.lag * push[k] if push is not None else 0.0)
        v = np.maximum(decay * v + (1 - decay) * pulled, 0.0)
    return SpeedDrive(np.arange(wanted.size, dtype=np.float64) * dt, target, speed, throttle)


# Design of the speed loop: base throttle from the law, P and I as fast as the worst of the family allows.
#
# CRUISE_THROTTLE over CRUISE_SPEED gives the steady throttle without feedback at one speed. P and I minimise
# the tracking error of steps of the commanded speed together with the error behind a slope, over all pairs
# whose loop keeps 6 dB and 45 deg for the intervals of gain, lag and delay and for a battery 10 % up or
# down, whose crossover lies where throttle and speed were coherent, which pass at most 5 % of noise to the
# throttle, and whose predicted step overshoots by at most 5 %.


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


def margins_of(loop: SpeedLoop, plants: list[SpeedPlant], settings: SpeedSettings) -> list[Margins]:
    """Margins of each plant."""
    w = frequencies(loop.period)
    shared = replace(loop.filters, d=settings.d)
    feedback = feedback_response(shared, np.array([settings.p]), np.array([settings.i]), loop.period, w)[0]
    scale = 1.0 - loop.least
    return [margins(feedback * plant.response(w, loop.period) * scale, w) for plant in plants]


def cruise(loop: SpeedLoop, plant: SpeedPlant, speed: float) -> tuple[float, float]:
    """(CRUISE_SPEED [m/s], CRUISE_THROTTLE [%]): the nearest whole percent, and the speed that it holds."""
    percent = float(np.clip(round(100 * loop.from_motor(plant.offset + speed / plant.gain)), 5, 100))
    return round(plant.gain * (loop.at_motor(percent / 100) - plant.offset), 2), percent


def without_dead_zone(loop: SpeedLoop, found: IdentifiedSpeed) -> SpeedLoop:
    """The loop with MOT_THR_MIN at the dead zone, in whole percent, if that is certain and not yet done.

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

    If no pair keeps 5 % overshoot, one of about the least.
    """
    plant = found.plant
    assert plant is not None
    at, percent = cruise(loop, plant, found.speeds[1])
    settings = SpeedSettings(at, percent, 0.0, 0.0, 0.0, accel_limit(loop, found))
    p, i = (grid.ravel() for grid in np.meshgrid(_P, _I))
    offered = (p * found.residual <= MOST_NOISE) & (p <= SLOWEST_INTEGRAL * plant.lag * i)
    p, i = p[offered], i[offered]
    w = frequencies(loop.period)
    paths = (each.response(w, loop.period) * (1.0 - loop.least) for each in found.family())
    coherent = found.band[1] if found.band is not None else np.inf
    keeps = robust(paths, loop.filters, loop.period, p, i, coherent)
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
    return replace(settings, p=rounded_down(p[best]), i=rounded_down(i[best]))
