"""The column of the steering: that which the yaw rate follows, and its unit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.logs.readers.column_grid import GRID_HZ, ColumnGrid, relation
from rover_sweep.logs.readers.column_lines import FoundColumn, certainty_of, column_entry, toml_value
from rover_sweep.logs.readers.column_map import FACTORS
from rover_sweep.logs.readers.column_names import (
    is_another,
    is_commanded,
    is_numbered,
    name_weight,
    origin_in,
    unit_in,
)
from rover_sweep.logs.readers.motion_columns import (
    LINK,
    MotionColumns,
    moving_parts,
    speed_is_known,
    yaw_rate_of,
)

NAMED = 0.7  # weight of a name that says the role
LAGS = range(-4, 13)  # steps of the grid from steering to yaw rate
LENGTHS = 0.1, 4.5  # m, of wheelbases
STEEPEST = 0.8  # rad, largest angle of a road wheel
RATIO_UNKNOWN = "identify with --wheelbase finds it, as steering_ratio; models need it as scale"


def steering_candidates(
    grid: ColumnGrid, motion: MotionColumns
) -> tuple[list[tuple[float, str, float, float, float, float]], str]:
    """([(score, column, share, curvature a unit, lag, weight of name)], best first; why there is none)."""
    sign = -1.0 if motion.turned else 1.0
    r = yaw_rate_of(grid, motion) * FACTORS["rad/s"][motion.units["r"]] * sign
    v = grid.x[motion.speed] * FACTORS["m/s"][motion.units["speed"]]
    v = v * (np.sign(np.median(v)) or 1.0)
    moving = moving_parts(grid, motion.speed)
    if moving.sum() < 40:
        return [], "the vehicle hardly moves"
    taken = {motion.r, motion.speed, motion.ay, motion.heading, *motion.position.split(", ")}
    tried = []
    for name in grid.dot:
        x, weight = grid.x[name], name_weight("steering", name)
        if name in taken or name in grid.made or name in grid.period or is_another("steering", name):
            continue
        k, share = relation(r, x)
        if weight < 0.3 and share > 0.97 and abs(log(abs(k))) < 0.05:  # another yaw rate
            continue
        share, gain, lag = _follows(r, v, x, moving)
        early = 0.3 * (lag < 0) + 0.1 * (lag == 0)
        if weight >= NAMED or is_numbered(name) or share > (0.2 if weight else 0.6):
            gain = gain if speed_is_known(grid, motion) else 0.0
            tried.append((share + 0.5 * weight - early, name, share, gain, lag, weight))
    tried.sort(key=lambda found: -found[0])
    if not tried or (tried[0][2] < 0.2 and tried[0][5] < NAMED):
        still = [n for n in grid.unchanged if name_weight("steering", n) >= NAMED]
        return [], f"{still[0]} does not change" if still else "no column moves the yaw rate"
    return tried, ""


def steering_lines(
    grid: ColumnGrid,
    motion: MotionColumns,
    tried: Sequence[tuple[float, str, float, float, float, float]],
    why: str,
    reverse: bool,
) -> Iterator[FoundColumn]:
    """The line of the steering, and of how its samples hold. tried, why: see `steering_candidates`."""
    if not tried:
        yield FoundColumn("delta", None, "", f"not found: steering; {why}", ('delta = "?"',))
        return
    best = tried[0]
    _, name, share, gain, lag, weight = best
    channel, more, unit_words = steering_unit(grid, name, gain)
    reasons = ["its name"] if weight >= 0.3 else []
    reasons.append(f"the yaw rate follows V times it ({100 * share:.0f} %), {lag:.2f} s later")
    if channel == "delta" and (gain < 0) != reverse and share > 0.2:
        more = {**more, "scale": -float(more.get("scale", 1.0))}
        reasons.append("sign changed: left is positive")
    reasons.append(unit_words)
    if lag < 0:
        reasons.append("the yaw rate leads it: are its clock or its column right?")
    strong = (share > 0.5) + (share > LINK) + (weight >= NAMED)
    others = [n for s, n, *_ in tried[1:4] if s > best[0] - 0.3 and s > 0.5]
    also = tuple(f"{channel} = {toml_value(column_entry(n, '', '', more))}" for n in others)
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


def _follows(r: Array, v: Array, u: Array, moving: NDArray[np.bool_]) -> tuple[float, float, float]:
    """(share explained, curvature g per unit, lag s) of r = V g u(t - lag) + offset V + bias, at its best."""
    inner = slice(max(LAGS), min(LAGS) or None)
    use = moving[inner]
    base = np.linalg.qr(np.stack((v[inner][use], np.ones(int(use.sum()))), 1))[0]

    def rest(x: Array) -> Array:
        return x - base @ (base.T @ x)

    y = rest(r[inner][use])
    moved = {lag: rest((v * np.roll(u, lag))[inner][use]) for lag in LAGS}
    shares = {lag: abs(float(y @ x)) / np.sqrt(float(x @ x) + 1e-300) for lag, x in moved.items()}
    best = max(LAGS, key=lambda lag: shares[lag])
    gain, share = relation(y, moved[best])
    return share, gain, best / GRID_HZ


def steering_unit(grid: ColumnGrid, name: str, gain: float) -> tuple[str, dict[str, Any], str]:
    """(channel, unit and scale, words on them) of the steering with this curvature per unit; 0 if unknown."""
    low, middle, high = (float(x) for x in np.percentile(grid.raw[name], (0.1, 50, 99.9)))
    if low > 700 and high < 2300 and 1100 < middle < 1900:
        return "pwm", {}, "pulses in us"
    size, told = max(abs(low), abs(high)), unit_in(name)
    lengths = {u: FACTORS["rad"][u] / abs(gain) if gain else 0.0 for u in ("rad", "deg")}
    fits = [u for u, x in lengths.items() if not x or LENGTHS[0] < x < LENGTHS[1]]
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
