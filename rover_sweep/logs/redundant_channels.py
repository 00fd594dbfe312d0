"""What a log holds several times, compared: speed, heading, direction of driving and yaw rate.

Of any rover, on an even grid and as means over a second:

    |V| = GPS speed = wheel speed       psi' = r = course'       a_y - g phi = V r

and the velocity points along the heading, ahead or in reverse as the throttle pushes. a_y and V r are
compared slowly and without a delay, because sideslip and the IMU's position make them differ in quick turns.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rover_sweep.data.geometry import STANDARD_GRAVITY
from rover_sweep.data.recording import Array, Complex, Mask, Signal
from rover_sweep.logs.log import THROTTLE, Log, output_channel
from rover_sweep.quality.redundant import ChannelRelation

GRID, SMOOTH = 0.1, 1.0  # s, of the grid and of the means
HOLE = 1.0  # s between samples, in which nothing is compared
MOVING, TURNING, FORCE = 0.5, 0.1, 0.3  # m/s, rad/s and m/s^2, from which ratios mean something
SHORTEST = 8.0  # s, of what is compared
CLEAR = 0.5  # share of a quantity that the other must give
PUSHES = 30.0  # us of throttle from its trim
LATE = 0.1  # s, by which a rover usually follows its steering
AGREE = 0.6  # mean agreement of two directions, from which it is a sign
# sd of the logarithms of the ratios; correct recordings of 4.5.7 and 4.6.3 have .98 to 1.00, .98 to 1.01,
# .93 to 1.01, .87 to 1.03 and (with the roll angle) .97 to 1.03
HEADING_SD, GYRO_SD, COURSE_SD, FORCE_SD = 0.03, 0.05, 0.1, 0.08
SPEEDS = {"gps_speed": 0.02, "wheel_speed": 0.02, "path_speed": 0.03}  # the slope of positions is noisier
LEANING = 1.055  # usual a_y over V r where no roll angle says how much of it is gravity (quality.relations)


@dataclass(frozen=True, eq=False)
class _Motion:
    """Means (n,) over `SMOOTH` at the times t (n,) s. Rates are those of `r`, left positive.

    velocity: along and left of the heading, m/s; speeds: others, m/s; turned, course: rates of heading and
    course, rad/s; throttle: -1, 0 or 1. NaN where not recorded, and near holes.
    """

    t: Array
    velocity: Complex
    r: Array
    second_r: Array
    turned: Array
    course: Array
    ay: Array
    speeds: Mapping[str, Array]
    throttle: Array

    @property
    def speed(self) -> Array:
        """(n,) m/s, without a direction."""
        return np.abs(self.velocity)

    @property
    def ahead(self) -> Array:
        """1 where the velocity points along the heading, -1 against it (n,)."""
        return np.sign(self.velocity.real)


def channel_relations(log: Log) -> tuple[ChannelRelation, ...]:
    """The relations between the channels of a log that it has enough driving for."""
    if not {"r", "speed"} <= set(log.signals) or (motion := _motion(log)) is None:
        return ()
    return tuple(_relations(motion, "vy" in log.signals, "phi" in log.signals))


def _motion(log: Log) -> _Motion | None:
    """The log on the grid, None where yaw rate and speed have no time in common."""
    signals, others = log.signals, log.witnesses
    r, speed = signals["r"], signals["speed"]
    if min(r.t.size, speed.t.size) < 3:
        return None
    t = np.arange(max(r.t[0], speed.t[0]), min(r.t[-1], speed.t[-1]), GRID)
    if t.size < SHORTEST / GRID:
        return None
    lateral = _smooth(signals.get("vy"), t) if "vy" in signals else np.zeros(t.size)
    velocity = _smooth(speed, t) + 1j * lateral
    psi, roll = signals.get("psi"), signals.get("phi")
    ay = _smooth(signals.get("ay"), t)
    if roll is not None:
        ay = ay - STANDARD_GRAVITY * np.nan_to_num(_smooth(roll, t))
    return _Motion(
        t,
        velocity,
        _smooth(r, t),
        _smooth(others.get("r2"), t),
        _rate(psi, t),
        _course(log, t),
        ay,
        {name: np.abs(_smooth(others[name], t)) for name in SPEEDS if name in others},
        _throttle(log, t),
    )


def steering_share(log: Log, steering: Signal) -> float:
    """Share of r/V that a record of the steering gives, as means over `SMOOTH`; 0 without driving."""
    if not {"r", "speed"} <= set(log.signals) or (m := _motion(log)) is None:
        return 0.0
    good = (m.speed > MOVING) & np.isfinite(m.r)
    if good.sum() * GRID < SHORTEST:
        return 0.0
    curvature, u = (m.r / np.maximum(m.speed, MOVING))[good], _smooth(steering, m.t - LATE)[good]
    known = np.isfinite(u)
    if known.sum() * GRID < SHORTEST or np.ptp(u[known]) == 0 or np.ptp(curvature[known]) == 0:
        return 0.0
    return float(np.corrcoef(curvature[known], u[known])[0, 1] ** 2)


def _smooth(signal: Signal | None, t: Array) -> Array:
    """Means (n,) over `SMOOTH` of a signal at the times t (n,), NaN without it and near its holes."""
    if signal is None or signal.t.size < 3:
        return np.full(t.size, np.nan)
    area = np.concatenate(([0.0], np.cumsum(0.5 * (signal.x[1:] + signal.x[:-1]) * np.diff(signal.t))))
    ends = (np.interp(t + side * SMOOTH / 2, signal.t, area) for side in (1, -1))
    return np.where(_in_hole(signal, t), np.nan, (next(ends) - next(ends)) / SMOOTH)


def _in_hole(signal: Signal, t: Array) -> Mask:
    """Times (n,) within `SMOOTH` of a hole of the signal, or outside of it."""
    k = np.clip(np.searchsorted(signal.t, t, "right"), 1, signal.t.size - 1)
    missing = (signal.t[k] - signal.t[k - 1] > HOLE) | (t < signal.t[0]) | (t > signal.t[-1])
    reach = round(SMOOTH / GRID)
    return np.convolve(missing, np.ones(2 * reach + 1), "same") > 0.5


def _course(log: Log, t: Array) -> Array:
    """Rate (n,) rad/s of the course over ground: of GPS, else of the velocity that the heading turned."""
    course = log.witnesses.get("gps_course")
    if course is not None and course.t.size > 3:
        moved = log.witnesses.get("gps_speed")
        path = replace(course, x=np.unwrap(course.x))
        rate = _rate(path, t)
        slow = _smooth(moved, t) < MOVING if moved is not None else np.zeros(t.size, bool)
        return np.where(slow, np.nan, rate)
    if not {"psi", "vy"} <= set(log.signals):
        return np.full(t.size, np.nan)
    speed = log.signals["speed"]
    toward = speed.x + 1j * np.interp(speed.t, log.signals["vy"].t, log.signals["vy"].x)
    angle = np.unwrap(np.angle(toward)) + log.signals["psi"].on(speed.t)
    path = replace(speed, x=angle)
    return _rate(path, t)


def _rate(signal: Signal | None, t: Array) -> Array:
    """Mean rate of change (n,) of an angle over `SMOOTH`, NaN without one and near holes."""
    if signal is None or signal.t.size < 3:
        return np.full(t.size, np.nan)
    rate = (signal.on(t + SMOOTH / 2) - signal.on(t - SMOOTH / 2)) / SMOOTH
    return np.where(_in_hole(signal, t), np.nan, rate)


def _throttle(log: Log, t: Array) -> Array:
    """Direction (n,) in which the throttle pushes, 0 near its trim, NaN where it was not recorded."""
    throttle = log.signals.get("throttle")
    if throttle is None or throttle.t.size < 3 or throttle.unit != "us":
        return np.full(t.size, np.nan)
    servo = f"SERVO{output_channel(log.parameters, THROTTLE) or 3}"
    push = np.interp(t, throttle.t, throttle.x) - log.parameters.get(f"{servo}_TRIM", 1500.0)
    push = push * (-1 if log.parameters.get(f"{servo}_REVERSED", 0) > 0 else 1)
    return np.where(np.abs(push) < PUSHES, 0.0, np.sign(push))


def _relations(m: _Motion, has_heading: bool, has_roll: bool) -> Iterator[ChannelRelation]:
    """Those that there is enough driving for. has_heading: the velocity has a sign, by a heading."""
    v = m.speed
    moving = v > MOVING
    for channel, other in m.speeds.items():
        if (ratio := _ratio(v, other, other > MOVING)) is not None:
            yield ChannelRelation(channel, {"speed": 1, channel: -1}, ratio, SPEEDS[channel])
    turning = np.abs(m.r) > TURNING
    for name, rate, sd in (
        ("psi", m.turned, HEADING_SD),
        ("course", np.where(moving, m.course, np.nan), COURSE_SD),
        ("r2", m.second_r, GYRO_SD),
    ):
        if (k := _slope(rate, m.r, turning)) is not None:
            yield ChannelRelation(name, {name: 1, "r": -1}, abs(k), sd, (name, "r"), int(np.sign(k)))
    vr = v * m.ahead * m.r
    if (k := _slope(m.ay, vr, moving & (np.abs(vr) > FORCE))) is not None:
        ratio = abs(k) / (1.0 if has_roll else LEANING)
        signs = ("ay", "r", *(("heading",) if has_heading else ()))
        exponents = {"ay": 1, "speed": -1, "r": -1}
        yield ChannelRelation("force", exponents, ratio, FORCE_SD, signs, int(np.sign(k)))
    pushed = moving & (np.abs(m.throttle) > 0)
    if has_heading and pushed.sum() * GRID > SHORTEST / 2:
        agreement = float(np.mean(m.throttle[pushed] * m.ahead[pushed]))
        if abs(agreement) > AGREE:
            sign = int(np.sign(agreement))
            yield ChannelRelation("throttle", {}, 1.0, 1.0, ("throttle", "heading"), sign)


def _ratio(y: Array, x: Array, keep: Mask) -> float | None:
    """y over x (n,) by the median, weighted with x; None with too little of it."""
    good = keep & np.isfinite(x) & np.isfinite(y) & (y > 0)
    if good.sum() * GRID < SHORTEST:
        return None
    ratio, weight = y[good] / x[good], x[good]
    order = np.argsort(ratio)
    share = np.cumsum(weight[order])
    return float(ratio[order[int(np.searchsorted(share, share[-1] / 2))]])


def _slope(y: Array, x: Array, turning: Mask) -> float | None:
    """Slope of y over x (n,) with a constant, by least absolute errors; None where x does not give y."""
    known = np.isfinite(x) & np.isfinite(y)
    if (known & turning).sum() * GRID < SHORTEST / 2:
        return None
    a, b = np.stack((x[known], np.ones(int(known.sum()))), 1), y[known]
    weight: Array = np.ones(b.size)
    for _ in range(20):
        scaled = a * weight[:, None]
        k = np.linalg.lstsq(scaled.T @ a, scaled.T @ b, rcond=None)[0]
        weight = 1 / np.maximum(np.abs(b - a @ k), 0.02 * float(np.std(b)) + 1e-9)
    mean = float(weight @ b / weight.sum())
    error = float(weight @ np.square(b - a @ k)) / max(float(weight @ np.square(b - mean)), 1e-300)
    return float(k[0]) if 1 - error > CLEAR and k[0] != 0 else None
