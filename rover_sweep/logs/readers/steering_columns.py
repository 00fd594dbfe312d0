"""The column of the steering: that which the yaw rate follows, and its unit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import log, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.logs.readers.column_grid import GRID_HZ, ColumnGrid, fit_odds, relation
from rover_sweep.logs.readers.column_lines import FoundColumn, certainty_of, column_entry, toml_value
from rover_sweep.logs.readers.column_map import FACTORS
from rover_sweep.logs.readers.column_names import SAID, is_commanded, name_weight, origin_in, unit_in
from rover_sweep.logs.readers.motion_columns import (
    LINK,
    MotionColumns,
    moving_parts,
    speed_is_known,
    yaw_rate_of,
)

NAMED = 0.7  # weight of a name that says the role
LAGS = range(-4, 13)  # steps of the grid from steering to yaw rate
LENGTHS, RATIO = (0.1, 4.5), 20.0  # m, of wheelbases; largest ratio of a steering wheel
CHARACTERISTIC = 20.0  # m/s, a usual characteristic speed, at which a wheelbase looks twice as long
SCREENED, LEAST = 8, 1.5  # candidates that are fitted; odds from which a column may be the steering
EARLY, AT_ONCE = 3.0, 1.0  # logarithms of odds: a yaw rate that leads its steering, or follows without delay
ANOTHER_RATE, UNLIKELY = 6.0, 3.0  # a second yaw rate; for each factor e of a wheelbase that no vehicle has
ALIKE = 2.2  # of the logarithm of the odds, within which two columns fit alike: 9 to 1
STEEPEST = 0.8  # rad, largest angle of a road wheel
RATIO_UNKNOWN = "identify with --wheelbase finds it, as steering_ratio; models need it as scale"


@dataclass(frozen=True)
class SteeringFit:
    """A column that may be the steering. odds: logarithm, of its name, its fit and the wheelbase it implies.

    share: of the yaw rate that V times it explains, lag [s] later. gain: curvature 1/m per unit, 0 where the
    speed is not known. weight: of its name.
    """

    name: str
    odds: float
    share: float
    gain: float
    lag: float
    weight: float


def steering_candidates(grid: ColumnGrid, motion: MotionColumns) -> tuple[tuple[SteeringFit, ...], str]:
    """(the columns that may be the steering, best first; why there is none)."""
    sign = -1.0 if motion.turned else 1.0
    r = yaw_rate_of(grid, motion) * FACTORS["rad/s"][motion.units["r"]] * sign
    v = grid.x[motion.speed] * FACTORS["m/s"][motion.units["speed"]]
    v = v * (np.sign(np.median(v)) or 1.0)
    moving = moving_parts(grid, motion.speed)
    if moving.sum() < 40:
        return (), "the vehicle hardly moves"
    taken = {motion.r, motion.speed, motion.ay, motion.heading, *motion.position.split(", ")}
    names = [n for n in grid.dot if not (n in taken or n in grid.made or n in grid.period)]
    lags, shares = _screened(r, v, np.stack([grid.x[n] for n in names], 1), moving) if names else ((), ())
    rough = [grid.odds("steering", n) + fit_odds(share) for n, share in zip(names, shares, strict=True)]
    first = sorted(zip(rough, names, lags, strict=True), reverse=True)
    known = speed_is_known(grid, motion)
    speed = float(np.median(v[moving])) if known else 0.0
    tried = [
        found
        for _, name, lag in first[:SCREENED]
        if (found := _candidate(grid, name, r, v, moving, lag, speed)).odds > LEAST
    ]
    tried.sort(key=lambda found: -found.odds)
    if not tried or (tried[0].share < 0.2 and tried[0].weight < NAMED):
        still = [n for n in grid.unchanged if name_weight("steering", n) >= NAMED]
        return (), f"{still[0]} does not change" if still else "no column moves the yaw rate"
    return tuple(tried), ""


def _candidate(
    grid: ColumnGrid, name: str, r: Array, v: Array, moving: NDArray[np.bool_], lag: int, speed: float
) -> SteeringFit:
    """speed: the usual one [m/s], 0 where it is not known."""
    x, weight = grid.x[name], name_weight("steering", name)
    k, direct = relation(r, x)
    same = direct > 0.97 and min(abs(log(abs(k) * f + 1e-12)) for f in (1.0, 180 / pi)) < 0.05
    gain, share = relation(*_moved(r, v, x, moving, lag))
    odds = (
        grid.odds("steering", name) + fit_odds(share) - (EARLY if lag < 0 else AT_ONCE if lag == 0 else 0.0)
    )
    odds -= ANOTHER_RATE if same and weight < 0.3 else 0.0
    if speed:
        odds -= _misfit(unit_in(name), gain, speed)
    return SteeringFit(name, odds, share, gain if speed else 0.0, lag / GRID_HZ, weight)


def _misfit(unit: str, gain: float, speed: float) -> float:
    """How unlikely the wheelbase is that an angle in its named unit implies, as a logarithm."""
    if unit not in ("rad", "deg") or not gain:
        return 0.0
    length = FACTORS["rad"][unit] / abs(gain)
    low, high = lengths_at(speed)
    beyond = max(0.0, log(low / length), log(length / high))
    return (
        min(UNLIKELY * beyond, SAID) if length < low else min(UNLIKELY * max(0.0, beyond - log(RATIO)), SAID)
    )


def lengths_at(speed: float) -> tuple[float, float]:
    """Wheelbases [m] that the curvature may show at this speed [m/s]: understeer makes them look longer."""
    low, high = LENGTHS
    return low, high * (1 + (speed / CHARACTERISTIC) ** 2)


def steering_lines(
    grid: ColumnGrid, motion: MotionColumns, tried: Sequence[SteeringFit], why: str, reverse: bool
) -> Iterator[FoundColumn]:
    """The line of the steering, and of how its samples hold. tried, why: see `steering_candidates`."""
    if not tried:
        yield FoundColumn("delta", None, "", f"not found: steering; {why}", ('delta = "?"',))
        return
    best = tried[0]
    name, share, gain, lag, weight = best.name, best.share, best.gain, best.lag, best.weight
    channel, more, unit_words = steering_unit(grid, name, gain, usual_speed(grid, motion))
    reasons = ["its name"] if weight >= 0.3 else []
    reasons.append(f"the yaw rate follows V times it ({100 * share:.0f} %), {lag:.2f} s later")
    if channel == "delta" and (gain < 0) != reverse and share > 0.2:
        more = {**more, "scale": -float(more.get("scale", 1.0))}
        reasons.append("sign changed: left is positive")
    reasons.append(unit_words)
    if lag < 0:
        reasons.append("the yaw rate leads it: are its clock or its column right?")
    strong = (share > 0.5) + (share > LINK) + (weight >= NAMED)
    others = [other for other in tried[1:4] if other.odds > best.odds - ALIKE]
    also = tuple(
        f"{channel} = {toml_value(column_entry(o.name, '', '', more))}  # fits alike ({100 * o.share:.0f} %)"
        for o in others
    )
    origin = origin_in(name)
    if origin != "unknown":
        more = {**more, "origin": origin}
        reasons.append(f"likely {origin}, by its name")
    elif channel == "delta":
        reasons.append("commanded or measured is not known, and gains need it")
        wanted = toml_value(column_entry(name, "", "", {**more, "origin": "commanded"}))
        also = (f'{channel} = {wanted}  # or "measured"', *also)
    yield FoundColumn(
        channel, column_entry(name, "", "", more), certainty_of(int(strong)), "; ".join(reasons), also
    )
    if grid.held[name] > 0.5 and is_commanded(name):
        yield FoundColumn("sampling", "step", "likely", f"{100 * grid.held[name]:.0f} % of its values repeat")


def _screened(r: Array, v: Array, x: Array, moving: NDArray[np.bool_]) -> tuple[list[int], list[float]]:
    """(best lag in steps, share) of each column of x (n, m): r = V g u(t - lag) + offset V + bias."""
    inner = np.arange(max(LAGS), r.size + min(min(LAGS), 0))
    at = inner[moving[inner]]
    base, y = _base(r, v, at)
    moved, weight = v[at] * y, v[at]
    found = []
    for lag in LAGS:
        u = x[at - lag]
        left = (weight**2) @ u**2 - np.sum(((base * weight[:, None]).T @ u) ** 2, axis=0)
        found.append((moved @ u) ** 2 / np.maximum(left * float(y @ y), 1e-300))
    shares = np.stack(found)
    best = np.argmax(shares, axis=0)
    return [LAGS[k] for k in best], [float(shares[k, n]) for n, k in enumerate(best)]


def _base(r: Array, v: Array, at: NDArray[np.int_]) -> tuple[Array, Array]:
    """(orthonormal base of offset V + bias, the yaw rate without them) in these samples."""
    base = np.linalg.qr(np.stack((v[at], np.ones(at.size)), 1))[0]
    return base, r[at] - base @ (base.T @ r[at])


def _moved(r: Array, v: Array, x: Array, moving: NDArray[np.bool_], lag: int) -> tuple[Array, Array]:
    """(the yaw rate, V times the column lag steps before), both without offset V + bias."""
    inner = np.arange(max(LAGS), r.size + min(min(LAGS), 0))
    at = inner[moving[inner]]
    base, y = _base(r, v, at)
    u = v[at] * x[at - lag]
    return y, u - base @ (base.T @ u)


def usual_speed(grid: ColumnGrid, motion: MotionColumns) -> float:
    """The median speed [m/s] in motion, 0 where it is not known."""
    if not speed_is_known(grid, motion):
        return 0.0
    v = np.abs(grid.x[motion.speed][moving_parts(grid, motion.speed)])
    return float(np.median(v)) * FACTORS["m/s"][motion.units["speed"]] if v.size else 0.0


def steering_unit(
    grid: ColumnGrid, name: str, gain: float, speed: float = 0.0
) -> tuple[str, dict[str, Any], str]:
    """(channel, unit and scale, words on them) of the steering with this curvature per unit; 0 if unknown.

    speed: at which it was seen [m/s].
    """
    low, middle, high = (float(x) for x in np.percentile(grid.raw[name], (0.1, 50, 99.9)))
    if low > 700 and high < 2300 and 1100 < middle < 1900:
        return "pwm", {}, "pulses in us"
    size, told = max(abs(low), abs(high)), unit_in(name)
    shortest, longest = lengths_at(speed)
    lengths = {u: FACTORS["rad"][u] / abs(gain) if gain else 0.0 for u in ("rad", "deg")}
    fits = [u for u, x in lengths.items() if not x or shortest < x < longest]
    normal = told not in lengths and min(abs(size - 1), abs(size / 100 - 1)) < 0.03
    angles = {"rad": size < STEEPEST, "deg": 3 < size < 60}
    unit = told if told in lengths else next((u for u in fits if angles[u]), "")
    if unit in fits and not normal and size * FACTORS["rad"][unit] < 1.2:
        why = "by its name" if told else "by its size"
        seen = f", as if the wheelbase were {lengths[unit]:.2g} m" if gain else ""
        words = f"{unit} {why}{seen}" + ("" if told else '; if it is of full steering: unit = "full"')
        return "delta", {"unit": unit} if unit == "deg" else {}, words
    if not normal and (unit or (size >= 60 and lengths["deg"] > 1)):
        unit = unit or "deg"
        words = f"{unit}, up to {size:.3g}, of a steering wheel? Its ratio is unknown: {RATIO_UNKNOWN}"
        return "delta", {"unit": unit} if unit == "deg" else {}, words
    full = next((f for f in (1.0, 100.0, 1000.0, 1e4) if size < 1.1 * f), 1e5)
    scale = {"scale": 1 / full} if full > 1 and size > 18 else {}
    words = f"no angle, up to {size:.3g}: its size in rad is unknown; {RATIO_UNKNOWN}"
    return "delta", {"unit": "full", **scale}, words
