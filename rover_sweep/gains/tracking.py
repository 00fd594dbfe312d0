"""How a controller of the firmware followed its target in a log: error, lag, overshoot, oscillation, and the
response of the rover to the controller's output."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import welch
from scipy.stats import t as student

from rover_sweep.data.controller_log import PAUSE, ControllerLog
from rover_sweep.data.recording import Array, Signal, stretches
from rover_sweep.data.results import NORMAL_90
from rover_sweep.driving.fit import OF_SPEED, fit_driving
from rover_sweep.driving.stretches import RATE, DrivenPart
from rover_sweep.gains.steering_chain import Autopilot, SampledPlant

MOVING = 0.5  # m/s; a slower rover does not turn
LEAST_STRETCH = 2.0  # s of uninterrupted driving
FINEST = 0.01  # s, of the even grid
LONGEST_LAG = 1.5  # s
HELD = 0.5  # s that a target is held before and after a step
MOST_RAMP = 1.5  # s from one held target to the next


@dataclass(frozen=True, eq=False)
class Even:
    """An uninterrupted stretch of driving on an even grid: columns (n,) of the log, a step `dt` [s] apart."""

    dt: float
    target: Array
    actual: Array
    output: Array
    speed: Array
    p: Array
    i: Array
    d: Array


def while_moving(log: ControllerLog) -> ControllerLog:
    """The rows in which the rover drives, in either direction."""
    return log.where(np.abs(log.speed) > MOVING)


def even_stretches(log: ControllerLog) -> list[Even]:
    """The uninterrupted stretches of a log of at least `LEAST_STRETCH`."""
    if log.t.size < 3:
        return []
    dt = max(float(np.median(np.diff(log.t))), FINEST)
    cuts = np.flatnonzero(np.diff(log.t) > PAUSE) + 1
    found = []
    for rows in np.split(np.arange(log.t.size), cuts):
        t = log.t[rows]
        if t[-1] - t[0] >= LEAST_STRETCH:
            grid = np.arange(t[0], t[-1], dt)
            columns = (log.target, log.actual, log.output, log.speed, log.p, log.i, log.d)
            found.append(Even(dt, *(np.interp(grid, t, c[rows]) for c in columns)))
    return found


@dataclass(frozen=True)
class Tracking:
    """rms: of the error, target_rms: of the target (in their units); lag [s]: delay at which the measurement
    follows the target best; follows: measurement / target at that delay; overshoot [% of the step]: median of
    `steps` steps from one held target to another, nan without two."""

    rms: float
    target_rms: float
    lag: float
    follows: float
    overshoot: float
    steps: int


def tracking(parts: Sequence[Even]) -> Tracking:
    """Tracking of all stretches."""
    target, actual = (np.concatenate([getattr(p, n) for p in parts]) for n in ("target", "actual"))
    lag, follows = _lag(parts)
    over = [value for part in parts for value in _overshoots(part)]
    return Tracking(
        float(np.sqrt(np.mean((target - actual) ** 2))),
        float(np.sqrt(np.mean(target**2))),
        lag,
        follows,
        float(np.median(over)) if len(over) > 1 else math.nan,
        len(over),
    )


def _lag(parts: Sequence[Even]) -> tuple[float, float]:
    """(delay [s], factor) of the delayed target that is nearest to the measurement."""
    best = (math.inf, 0.0, math.nan)
    for shift in range(round(LONGEST_LAG / parts[0].dt)):
        xx = xy = yy = 0.0
        for part in parts:
            x, y = part.target[: part.target.size - shift], part.actual[shift:]
            xx, xy, yy = xx + float(x @ x), xy + float(x @ y), yy + float(y @ y)
        if xx > 0 and yy > 0:
            best = min(best, (1 - xy**2 / (xx * yy), shift * parts[0].dt, xy / xx))
    return best[1:]


def _overshoots(part: Even) -> Iterator[float]:
    """Overshoot [%] of each step of the target between two values held for `HELD`."""
    target, wide = part.target, round(HELD / part.dt)
    tolerance = 0.02 * float(np.abs(target).max())
    still = np.abs(np.diff(target)) <= tolerance * part.dt / HELD
    held = [(first, last + 1) for first, last in stretches(still) if last + 1 - first >= wide]
    for (_, before), (begin, end) in zip(held, held[1:], strict=False):
        size = target[begin] - target[before]
        if abs(size) > 10 * tolerance and (begin - before) * part.dt <= MOST_RAMP:
            beyond = np.sign(size) * (part.actual[before:end] - target[begin])
            yield 100 * max(float(beyond.max()), 0.0) / abs(size)


@dataclass(frozen=True)
class Response:
    """Turn rate r = gain V (u + trim), behind a first-order lag and a delay; u: share of the steering's
    travel after the scaling with speed, V: speed [m/s].

    gain [1/m] with its 90 % interval; lag, delay [s]; trim: share of the travel; fit: share of the
    turn rate's variance that is explained in pieces that were not fitted; speed [m/s]: mean, negative in
    reverse.
    """

    gain: float
    interval: tuple[float, float]
    lag: float
    delay: float
    trim: float
    fit: float
    speed: float

    def feed_forward(self, autopilot: Autopilot) -> float:
        """FF [1/(rad/s)] that holds a steady turn at the mean speed."""
        return 1.0 / (self.gain * abs(self.speed) * autopilot.speed_scale(self.speed))

    def plant(self, autopilot: Autopilot) -> SampledPlant:
        """Plant from the share of travel to the turn rate [rad/s], at the mean speed."""
        decay, steady = math.exp(-autopilot.period / self.lag), self.gain * abs(self.speed)
        a, b, c = np.array([[decay]]), np.array([(1 - decay) * steady]), np.ones(1)
        return SampledPlant(a, b, c, round(self.delay / autopilot.period), autopilot.period, self.speed)


TRIM = 0.05  # of the travel, standard deviation of the trim's error
LEFT_OUT = (*OF_SPEED, "side")
LEAST_HALF_WIDTH = 0.03  # of the gain: error of the assumed law


def response(parts: Sequence[Even], autopilot: Autopilot) -> Response | None:
    """The response fitted to all stretches as to any driving; None if the steering hardly moved.

    Backwards the firmware turns the steering to the other side (`AP_MotorsUGV::output_regular`), so the turn
    rate follows the output in both directions.
    """
    driven = [_driven(part, autopilot) for part in parts]
    if not any(np.ptp(part.steering.x) for part in driven):
        return None
    try:
        found = fit_driving(driven, {"straight": (0.0, TRIM)}, LEFT_OUT)
    except ValueError:  # no stretch is long enough
        return None
    gain = found["gain"]
    if not gain > 0:
        return None  # `against` says whether the rover turns to the other side
    low, high = found.interval({"gain": 1.0}, gain)
    half = LEAST_HALF_WIDTH * gain
    ends = float(min(low, gain - half)), float(max(high, gain + half))
    mean = float(np.mean(np.concatenate([part.speed for part in parts])))
    return Response(gain, ends, found["lag"], found["delay"], -found["straight"], found.explained, mean)


LATEST, STEPS = 0.6, 13  # s, largest delay between steering and turn, and number of delays tried


def against(parts: Sequence[Even], autopilot: Autopilot) -> float:
    """Correlation of the turn rate with speed times the steering's travel, at the delay of its largest size.

    -1 where the rover turns to the other side of every output, 0 where steering or turn rate stayed 0. Means
    are kept: in a turn that is held at a stop, the side says it all.
    """
    best = 0.0
    for late in np.linspace(0.0, LATEST, STEPS):
        xx = xy = yy = 0.0
        for part in parts:
            shift = round(late / part.dt)
            travel = _travel(part, autopilot) * np.abs(part.speed)
            x, y = travel[: travel.size - shift], part.actual[shift:]
            xx, xy, yy = xx + float(x @ x), xy + float(x @ y), yy + float(y @ y)
        if xx > 0 and yy > 0 and abs(found := xy / math.sqrt(xx * yy)) > abs(best):
            best = found
    return best


HELD_TRAVEL = 0.4  # share of the travel from which a held turn shows the gain, its trim being unknown
HELD_WITHIN = 0.1  # of the travel
LEAST_HELD = 3  # turns, s each of `HELD_TURN`
HELD_TURN, SETTLING = 1.0, 0.8  # s


def held_feed_forward(parts: Sequence[Even], autopilot: Autopilot) -> tuple[float, float, float] | None:
    """FF [1/(rad/s)] that holds a steady turn, with its 90 % interval, from turns in which the steering was
    held, as at a stop; None with fewer than `LEAST_HELD` s of them.

    A steering that hardly leaves its stops has no response to fit, but its steady turns show the gain: r over
    V times the share of travel. The interval is that of their mean, and that of a trim of `TRIM`.
    """
    gains, speeds, shares = [], [], []
    for part in parts:
        travel, length = _travel(part, autopilot), round(HELD_TURN / part.dt)
        wait = round(SETTLING / part.dt)
        for first in range(wait, travel.size - length + 1, length):
            held = travel[first - wait : first + length]
            if np.ptp(held) > HELD_WITHIN or abs(held.mean()) < HELD_TRAVEL:
                continue
            speed = float(np.mean(np.abs(part.speed[first : first + length])))
            share = float(held.mean())
            gains.append(float(np.mean(part.actual[first : first + length])) / (speed * share))
            speeds.append(speed)
            shares.append(abs(share))
    if len(gains) < LEAST_HELD or not np.mean(gains) > 0:
        return None
    gain, speed = float(np.mean(gains)), float(np.mean(speeds))
    scatter = float(student.ppf(0.95, len(gains) - 1)) * float(np.std(gains, ddof=1)) / math.sqrt(len(gains))
    half = math.hypot(scatter / gain, NORMAL_90 * TRIM / float(np.mean(shares)), LEAST_HALF_WIDTH)
    found = 1.0 / (gain * speed * autopilot.speed_scale(speed))
    return found, found / (1 + half), found / max(1 - half, 0.1)


def _travel(part: Even, autopilot: Autopilot) -> Array:
    """Share of the steering's travel (n,), 1 to the stop."""
    scale = np.array([autopilot.speed_scale(v) for v in part.speed])
    return np.clip(part.output * scale, -1.0, 1.0)


def _driven(part: Even, autopilot: Autopilot) -> DrivenPart:
    """The stretch with the share of the steering's travel, 1 to the stop, as its steering."""
    since = np.asarray(np.arange(part.output.size) * part.dt, float)
    t = np.arange(0.0, since[-1], 1 / RATE)
    steering = Signal(since, _travel(part, autopilot), "of the travel", hold=False)
    speed = np.interp(t, since, np.abs(part.speed))
    return DrivenPart("", t, speed, np.interp(t, since, part.actual), steering, None)


# A narrow-band oscillation that is in the measurement and not in the target.


LOWEST_HZ, HIGHEST_HZ = 0.4, 8.0
WINDOW = 4.0  # s, of a spectrum
NARROW = 1.35  # factor from its middle to the ends of a narrow band
LEAST_SHARE = 0.5  # of the error's power above LOWEST_HZ
LEAST_OVER_TARGET = 4.0  # power of the measurement over that of the target
LEAST_OF_TARGET = 0.1  # rms of the oscillation over that of the target


@dataclass(frozen=True)
class Oscillation:
    """hz: its frequency; rms: of the measurement, in its unit; shares: of P, I and D in the output's
    oscillation, by name."""

    hz: float
    rms: float
    shares: dict[str, float]

    @property
    def term(self) -> str:
        """The term that drives it."""
        return max(self.shares, key=lambda name: self.shares[name])


def oscillation(log: ControllerLog, parts: Sequence[Even], least: float) -> Oscillation | None:
    """The oscillation in a log of rows that move; None without one. least: rms [unit of the target]."""
    w, powers = _spectra(parts)
    error, actual, target = powers["error"], powers["actual"], powers["target"]
    inside = (w >= LOWEST_HZ) & (w <= HIGHEST_HZ)
    if not np.any(inside) or not error[inside].sum() > 0:
        return None
    hz = float(w[inside][np.argmax(error[inside])])
    band = inside & (w >= hz / NARROW) & (w <= hz * NARROW)
    rms = math.sqrt(float(actual[band].sum() * (w[1] - w[0])))
    if (
        error[band].sum() < LEAST_SHARE * error[inside].sum()
        or actual[band].sum() < LEAST_OVER_TARGET * target[band].sum()
        or rms < max(least, LEAST_OF_TARGET * float(np.sqrt(np.mean(log.target**2))))
    ):
        return None
    size = {name: math.sqrt(float(powers[name.lower()][band].sum())) for name in ("P", "I", "D")}
    return Oscillation(hz, rms, {name: value / sum(size.values()) for name, value in size.items()})


def _spectra(parts: Sequence[Even]) -> tuple[Array, dict[str, Array]]:
    """(frequencies (n,) [Hz], power densities (n,) of error, actual, target, p, i and d) of all stretches."""
    dt, found = parts[0].dt, dict[str, Array]()
    length = min(round(WINDOW / dt), min(p.target.size for p in parts))
    for part in parts:
        columns = {name: getattr(part, name) for name in ("actual", "target", "p", "i", "d")}
        for name, x in {**columns, "error": part.target - part.actual}.items():
            power = welch(x, fs=1 / dt, nperseg=length)[1] * part.target.size
            found[name] = found.get(name, 0.0) + power
    count = sum(part.target.size for part in parts)
    return np.arange(length // 2 + 1) / (length * dt), {name: power / count for name, power in found.items()}


# The firmware's limits of the target and of the steering.


RAMP = 0.1  # s, over which the slope of the target is taken
NEAR = 0.97  # of a limit that counts as reached


@dataclass(frozen=True)
class Limited:
    """parameter: the limit, "" for the stops of the steering; seconds, share: time at it, of all driving;
    ramp [s]: median length of its stretches."""

    parameter: str
    seconds: float
    share: float
    ramp: float


def limited(log: ControllerLog, autopilot: Autopilot) -> tuple[Limited, ...]:
    """The limits that were reached, with rows that move."""
    by_speed = np.array([autopilot.speed_scale(v) for v in log.speed])
    most = np.array([autopilot.force_limit(v) for v in log.speed])
    size, half = np.abs(log.target), RAMP / 2
    slope = (np.interp(log.t + half, log.t, log.target) - np.interp(log.t - half, log.t, log.target)) / RAMP
    masks = {
        "ATC_STR_RAT_MAX": (autopilot.rate_max > 0) & (size >= NEAR * autopilot.rate_max),
        "ATC_TURN_MAX_G": size >= NEAR * most,
        "ATC_STR_ACC_MAX": (autopilot.accel_max > 0) & (np.abs(slope) >= NEAR * autopilot.accel_max),
        "": np.abs(log.output * by_speed) >= 1.0,
    }
    dt, found = float(np.median(np.diff(log.t))), []
    for name, mask in masks.items():
        if lengths := [last + 1 - first for first, last in stretches(mask)]:
            ramp = float(np.median(lengths)) * dt
            found.append(Limited(name, float(mask.sum()) * dt, float(mask.mean()), ramp))
    return tuple(found)
