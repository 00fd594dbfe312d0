"""The columns of yaw rate, speed and lateral acceleration, by what must hold between them in any vehicle."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import log, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.logs.readers.column_grid import EVERY, GRID_HZ, ColumnGrid, fit_odds, means, relation
from rover_sweep.logs.readers.column_map import DEGREE, FACTORS, course_rate
from rover_sweep.logs.readers.column_names import (
    is_numbered,
    is_rotation,
    name_weight,
    says_nothing,
    unit_in,
    without_unit,
    words_of,
)
from rover_sweep.logs.readers.mounted_imu import add_sideways, add_upright, gravity

LINK = 0.8  # share of the variance, from which a relation between two columns counts
WEAK = 0.35  # from which it is used for units and signs
UNIT = 0.15  # of the natural logarithm of a factor, within which it is that of a unit
HARDEST, TIGHTEST = 25.0, 0.5  # m/s^2 and m, of turns that vehicles of usual sizes drive
SLOWEST, FASTEST = 0.3, 60.0  # m/s, of speeds that were not recorded
# Logarithms of odds of what is made of several columns, against a column whose name says nothing
OF_UPRIGHT, OF_VELOCITIES, OF_POSITIONS, OF_NUMBERED = 5.0, 3.0, 1.5, -2.0
OF_HEADING, OF_PATH, NOT_RECORDED = 3.0, 0.5, -1.0
CROWD = 40  # columns, from which chance finds one that is V times another
NEAREST = 3  # headings of which each column may be the slope
WRAPS = 4.0  # against a yaw rate that jumps as an angle does
NEARER = 0.02  # of a share, by which a column must be nearer to one position's slope than to the speed
AHEAD = 0.87  # mean cosine between heading and course, from which they agree: 30 degrees
COURSE = 0.5  # likewise for the course over ground, from which a slipping vehicle turns away
UNRECORDED = "(a speed that was not recorded)"
# {unit: minus the logarithm of how often files have it}
SPEED_UNITS = {"m/s": 0.0, "km/h": 0.7, "mph": 1.0, "ft/s": 2.5}
RATE_UNITS = {"rad/s": 0.0, "deg/s": 0.3}
ACCELERATION_UNITS = {"m/s^2": 0.0, "g": 0.3, "ft/s^2": 2.5}


@dataclass(frozen=True)
class MotionColumns:
    """What was found of the motion. r: column of the yaw rate, or of the heading it is the slope of.

    links: {what: (factor, share)} of the relations that speak for it. units: {role: unit}. turned: the yaw
    rate is positive to the right. sure: how clearly the units are the best ones.
    """

    r: str = ""
    speed: str = ""
    ay: str = ""
    heading: str = ""
    position: str = ""
    links: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    turned: bool = False
    sure: float = 0.0


@dataclass(frozen=True, eq=False)
class _Ground:
    """Speed over ground (n,) m/s and rate of the course (n,) rad/s of two position columns, and their means.

    place: the map's entry for the positions themselves; made: that for both, of velocities where there are
    any. course: (n,) rad from the first axis. slopes: (share, column) of a velocity for each position.
    path: the grid's column of the course.
    """

    name: str
    place: dict[str, Any]
    made: dict[str, Any]
    path: str
    speed: Array
    course: Array
    slopes: tuple[tuple[float, str], ...]
    mean_speed: Array
    mean_rate: Array


def _grounds(grid: ColumnGrid) -> Iterator[_Ground]:
    """What pairs of columns give that may be a position: x and y, east and north, longitude and latitude."""
    parts = {n for made in grid.made.values() for n in made.get("quaternion", ())}
    moving = ("r", "p", "ax", "ay", "vy", "speed", "steering")
    names = [n for n in grid.dot if n not in parts and all(name_weight(role, n) < 0.6 for role in moving)]
    for k, one in enumerate(names):
        words = words_of(without_unit(one))
        for x, y in _AXES:
            if words.split()[-1:] != [x] and not words.endswith(f"pos{x}"):
                continue
            other = y.join(words.rsplit(x, 1))
            two = next((n for n in names if words_of(without_unit(n)) == other), "")
            if two and grid.stream[one] == grid.stream[two]:
                yield _ground(grid, one, two, degrees=x.startswith("l"))
        two = names[k + 1] if k + 1 < len(names) else ""
        if two and is_numbered(one) and re.sub(r"\d+\]?$", "", one) == re.sub(r"\d+\]?$", "", two):
            yield _ground(grid, one, two)


_AXES = (
    *(("x", "y"), ("east", "north"), ("e", "n")),
    *(("lon", "lat"), ("lng", "lat"), ("long", "lat"), ("longitude", "latitude")),
)


def _ground(grid: ColumnGrid, one: str, two: str, degrees: bool = False) -> _Ground:
    """The made columns are of two velocities, where these are the slopes of the positions, at any scale."""
    vx, vy = grid.dot[one], grid.dot[two]
    made: dict[str, Any]
    place = made = {"position": [one, two]}
    slopes = () if degrees else (_slope_of(grid, one), _slope_of(grid, two))
    if degrees:
        whole = float(np.max(np.abs(grid.x[two]))) > 400  # 1e-7 degrees, as in MAVLink
        scale = 1e-7 if whole else 1.0
        place = made = {"lat_lon": [two, one], **({"scale": scale} if whole else {})}
        vx = vx * scale * DEGREE * np.cos(np.radians(scale * grid.x[two]))
        vy = vy * scale * DEGREE
    elif all(pair := [name for _, name in slopes]):
        made, (vx, vy) = {"velocity": pair}, (grid.x[name] for name in pair)
    speed = np.hypot(vx, vy)
    rate = course_rate(vx, vy, np.gradient(vx) * GRID_HZ, np.gradient(vy) * GRID_HZ)
    course = np.unwrap(np.arctan2(vy, vx))
    path = "" if is_numbered(one) else f"path {one}, {two}"
    if path:
        grid.make(path, made, one, course, rate)
    return _Ground(f"{one}, {two}", place, made, path, speed, course, slopes, means(speed), means(rate))


def motion_candidates(grid: ColumnGrid) -> list[tuple[float, MotionColumns]]:
    """(logarithm of the odds, yaw rate, speed and lateral acceleration that may belong together), best first.

    Names shift the odds, and so do the relations between the columns; neither decides alone.
    """
    if not grid.dot:
        return []
    grounds = list(_grounds(grid))
    add_upright(grid)
    speeds = sorted(_speeds(grid, grounds), key=lambda s: -s[0])[:6]
    named = [name for _, name, _, _ in speeds if name not in grid.made and name_weight("speed", name) >= 0.5]
    speeds += [] if named else _made_speeds(grid, grounds)
    if not speeds:  # a constant one that was not recorded
        grid.x[UNRECORDED] = np.ones_like(next(iter(grid.x.values())))
        speeds = [(NOT_RECORDED, UNRECORDED, None, (0.0, 0.0))]
    found: list[tuple[float, MotionColumns]] = []
    headings = _headings(grid)
    for odds, name, ground, place in speeds:
        moving = moving_parts(grid, name)
        for more, shown, one in _yaw_rates(grid, headings, ground, moving, place):
            if not shown and len(grid.dot) > CROWD:
                continue
            tried = _with_acceleration(grid, replace(one, speed=name), moving)
            k, share = tried.links.get("V r", (0.0, 0.0))
            if shown or (share > LINK and name != UNRECORDED and _is_unit_of_acceleration(k)):
                found.append((odds + more + _of_acceleration(grid, tried.ay, share), tried))
    return sorted(found, key=lambda pair: -pair[0])


def _of_acceleration(grid: ColumnGrid, name: str, share: float) -> float:
    """What a_y = V r says for all three; less of a column that was chosen among many for its fit."""
    if share < WEAK:
        return 0.0
    if name in grid.made or not says_nothing(name):
        return fit_odds(share)
    return max(0.0, 0.5 * fit_odds(share) - log(len(grid.dot)))


def _is_unit_of_acceleration(k: float) -> bool:
    """True for a ratio of a_y to V r in usual units of all three."""
    units = product(SPEED_UNITS, RATE_UNITS, ACCELERATION_UNITS)
    usual = ((v, r, a) for v, r, a in units if "ft" not in v + a)
    ratios = (FACTORS["m/s"][v] * FACTORS["rad/s"][r] / FACTORS["m/s^2"][a] for v, r, a in usual)
    return any(abs(log(abs(k) / ratio + 1e-12)) < UNIT for ratio in ratios)


def moving_parts(grid: ColumnGrid, speed: str) -> NDArray[np.bool_]:
    """Where (n,) on the grid the vehicle moves, by this column of the speed."""
    v = np.abs(grid.x[speed])
    return v > 0.2 * np.percentile(v, 95)


def _made_speeds(
    grid: ColumnGrid, grounds: Sequence[_Ground]
) -> Iterator[tuple[float, str, _Ground | None, tuple[float, float]]]:
    """Speeds as `_speeds` gives them, made of two velocities, or else of two positions."""
    for ground in grounds:
        (way, names), *_ = ground.made.items()
        grid.make(title := f"{way} {', '.join(names)}", ground.made, names[0], ground.speed)
        odds = OF_VELOCITIES if way == "velocity" else OF_POSITIONS if ground.path else OF_NUMBERED
        yield odds, title, ground, (1.0, 1.0)


def _slope_of(grid: ColumnGrid, position: str) -> tuple[float, str]:
    """(share, the column) that is the slope of a position, at any scale; (LINK, "") without one.

    A velocity with a scale of its own is one all the same: `path_speed` then contradicts it.
    """
    best = (LINK, "")
    for name in grid.dot:
        if grid.stream[name] == grid.stream[position] and name not in grid.made:
            k, share = relation(grid.mean[name], grid.mean_dot[position])
            best = max(best, (share if k > 0 else 0.0, name))
    return best


def _speeds(
    grid: ColumnGrid, grounds: Sequence[_Ground]
) -> Iterator[tuple[float, str, _Ground | None, tuple[float, float]]]:
    """(score, column, position whose slope it is, (metres per second of its unit, share))."""
    components = [slope for g in grounds for slope in g.slopes]
    for name in list(grid.dot):
        x, weight = grid.x[name], name_weight("speed", name)
        forward = float(np.mean(x * np.sign(np.median(x)) > -0.05 * np.max(np.abs(x))))
        if is_rotation(name) and name not in grid.made:
            yield _of_rotation(grid, name, grounds)
            continue
        if name in grid.made or (weight < 0.5 and forward < 0.9):
            continue
        odds = grid.odds("speed", name)
        links = [(*relation(g.mean_speed, np.abs(grid.mean[name])), g) for g in grounds if name not in g.name]
        k, share, ground = max(links, key=lambda pair: pair[1], default=(0.0, 0.0, None))
        margin = NEARER if weight >= 0.5 else 0.0
        if any(part > share + margin for part, component in components if component == name):
            continue  # a velocity to the north, which is the speed only on straight roads
        units = (abs(log(abs(k) / FACTORS["m/s"][u] + 1e-12)) for u in SPEED_UNITS)
        if share > LINK and k > 0 and (min(units) < UNIT or not grid.timed):
            yield odds + fit_odds(share), name, ground, (k, share)
        elif weight >= 0.3 or (says_nothing(name) and forward > 0.99):
            near = ground if ground and ground.path and share > 0.5 and k > 0 else None
            yield odds, name, near or (grounds[0] if grounds else None), (k, share if near else 0.0)


def _of_rotation(
    grid: ColumnGrid, name: str, grounds: Sequence[_Ground]
) -> tuple[float, str, _Ground | None, tuple[float, float]]:
    """A speed as `_speeds` gives it, of a wheel's or motor's revolutions; 1 m/s without a scale."""
    x = grid.x[name]
    links = [(*relation(g.mean_speed, np.abs(grid.mean[name])), g) for g in grounds]
    k, share, ground = max(links, key=lambda pair: pair[1], default=(0.0, 0.0, None))
    scaled = share > LINK and k > 0
    scale = float(k if scaled else 1 / (np.percentile(np.abs(x), 95) + 1e-12))
    scale *= -1 if np.median(x) < 0 else 1
    grid.make(title := f"{name} times its scale", {"column": name, "scale": scale}, name, scale * x)
    odds = fit_odds(share) if scaled else 0.0
    return odds, title, ground if scaled else None, (1.0, share) if scaled else (0.0, 0.0)


def with_scale(grid: ColumnGrid, motion: MotionColumns) -> MotionColumns:
    """With a speed of revolutions scaled by a_y over r, where no position does it; else its scale is 0."""
    made = grid.made.get(motion.speed, {})
    if "column" not in made or "position" in motion.links:
        return motion
    k, share = motion.links.get("V r", (0.0, 0.0))
    factor = FACTORS["m/s^2"][motion.units["ay"]] / FACTORS["rad/s"][motion.units["r"]]
    made["scale"] *= abs(k) * factor if share > LINK else 0.0
    if share > LINK:
        grid.make(motion.speed, made, made["column"], abs(k) * factor * grid.x[motion.speed])
        return replace(motion, links={**motion.links, "V r": (np.sign(k) / factor, share)})
    return motion


def speed_is_known(grid: ColumnGrid, motion: MotionColumns) -> bool:
    """False for a speed that was not recorded, and for revolutions that nothing scales."""
    return motion.speed != UNRECORDED and grid.made.get(motion.speed, {}).get("scale", 1.0) != 0


@dataclass(frozen=True)
class _Headings:
    """weights: {column: how much says that it is a heading}; of: {column: headings whose slope it may be}."""

    weights: Mapping[str, float]
    of: Mapping[str, tuple[str, ...]]


def _headings(grid: ColumnGrid) -> _Headings:
    weights = {
        name: max(
            name_weight("psi", name),
            0.8 * bool(grid.period.get(name)),
            1.0 * ("quaternion" in grid.made.get(name, ())),
            0.1 * (says_nothing(name) and bool(np.ptp(grid.x[name]) > 1)),
        )
        for name in grid.dot
        if name not in grid.made or "quaternion" in grid.made[name]
    }
    names, psi = list(grid.mean), [name for name, weight in weights.items() if weight]
    if not psi:
        return _Headings(weights, dict.fromkeys(names, ()))
    x, slopes = (
        np.stack([_standard(of[n]) for n in some]) for of, some in ((grid.mean, names), (grid.mean_dot, psi))
    )
    nearest = np.argsort(-np.abs(x @ slopes.T), axis=1)[:, : NEAREST + 1]
    found = {n: tuple(psi[k] for k in row if psi[k] != n) for n, row in zip(names, nearest, strict=True)}
    return _Headings(weights, found)


def _standard(x: Array) -> Array:
    away = x - x.mean()
    return np.asarray(away / (np.linalg.norm(away) + 1e-300))


def _yaw_rates(
    grid: ColumnGrid,
    headings: _Headings,
    ground: _Ground | None,
    moving: NDArray[np.bool_],
    place: tuple[float, float],
) -> Iterator[tuple[float, bool, MotionColumns]]:
    """(odds, evidence, what is known) of each column that may be the yaw rate, or the heading that gives it.

    evidence: False where neither the name nor a heading or course speaks for it, so that a_y must.
    """
    position = ground.name if ground and place[1] else ""
    for name in list(grid.dot):
        weight = name_weight("r", name)
        made = grid.made.get(name, {})
        if made and "along" not in made:
            continue
        links: dict[str, tuple[float, float]] = {"position": place} if position else {}
        weight = 1.0 if made else 0.0 if name in grid.period else weight
        odds = OF_UPRIGHT if made else grid.odds("r", name) - WRAPS * (name in grid.period)
        pairs = [(*relation(grid.mean[name], grid.mean_dot[h]), h) for h in headings.of.get(name, ())]
        k, share, heading = max(pairs, key=lambda pair: pair[1], default=(0.0, 0.0, ""))
        if share > LINK and (_is_unit_factor(k) or not grid.timed):
            links["heading"] = (k, share)
        if ground is not None and position:
            course = relation(grid.mean[name], ground.mean_rate, moving[::EVERY])
            if course[1] > WEAK and (_is_unit_factor(course[0], COURSE) or not grid.timed):
                links["course"] = course
        evidence = sum(links[n][1] for n in ("heading", "course") if n in links)
        told = share > 0.9 and "heading" in links and headings.weights[heading] >= 0.8
        odds += fit_odds(links["heading"][1]) if "heading" in links else 0.0
        odds += 0.5 * fit_odds(links["course"][1]) if "course" in links else 0.0
        one = MotionColumns(
            name, heading=heading if "heading" in links else "", position=position, links=links
        )
        yield odds, weight >= 0.3 or evidence > 1.2 or told, one
    for name, weight in headings.weights.items():
        if weight < 0.6:
            continue
        course = (
            relation(grid.mean_dot[name], ground.mean_rate, moving[::EVERY])
            if ground and position
            else (0.0, 0.0)
        )
        share = course[1]
        links = {"position": place} if position else {}
        links |= {"course": course} if share > WEAK else {}
        odds = OF_HEADING * weight + (0.5 * fit_odds(share) if share > WEAK else 0.0)
        yield odds, True, MotionColumns(name, heading=name, position=position, links=links)
    if ground is not None and ground.path:
        links = {"position": place} if position else {}
        yield (
            OF_PATH,
            True,
            MotionColumns(ground.path, heading=ground.path, position=ground.name, links=links),
        )


def _is_unit_factor(k: float, within: float = UNIT) -> bool:
    """True for the ratio of two rates of turn, each in rad/s or deg/s."""
    return any(abs(log(abs(k) * factor + 1e-12)) < within for factor in (1.0, pi / 180, 180 / pi))


def direction(grid: ColumnGrid, motion: MotionColumns, gain: float) -> tuple[bool, str]:
    """(whether all was driven in reverse, why) of a speed that has one sign.

    gain: of the yaw rate over |V| times the steering angle, 0 where that is no angle. The heading against the
    course decides; else reverse needs fewer wrong signs: a_y = V r and r = V g delta hold with the sign of V.
    """
    x = grid.x[motion.speed]
    back = float(np.median(x)) < 0
    path, heading = grid.x.get(f"path {motion.position}"), motion.heading
    if path is not None and heading in grid.dot and heading != motion.r and (back or np.min(x) >= 0):
        unit = _angle_unit(grid, heading) or motion.units["r"].partition("/")[0]
        psi = grid.x[heading] * FACTORS["rad"][unit]
        away = (pi / 2 - psi if motion.turned else psi) - path
        side = float(np.mean(np.cos(away[moving_parts(grid, motion.speed)])))
        if abs(side) > AHEAD:
            ahead = "along" if side > 0 else "against"
            words = f"the heading points {ahead} the course: driven {'forward' if side > 0 else 'in reverse'}"
            return side < 0, words if back or side < 0 else ""
    if not back:
        return False, ""
    k, share = motion.links.get("V r", (0.0, 0.0))
    lateral = 2.0 * np.sign(k) * (-1 if motion.turned else 1) if share > WEAK else 0.0
    forward = lateral + np.sign(gain) - 1.0  # the sign of the speed itself speaks for reverse
    if abs(forward) < 2:
        words = "most of it is below 0, and nothing in the file says whether that is reverse or a wrong sign"
        return False, f"{words}: taken as forward; if it was reverse, leave the scale out"
    why = [*(["a_y"] if lateral else []), *(["the steering"] if gain else [])]
    way = "driven forward: its sign is changed" if forward > 0 else "driven in reverse"
    return forward < 0, f"most of it is below 0; by the sign of {' and of '.join(why)}, {way}"


def other_speed(
    grid: ColumnGrid, motion: MotionColumns, steering: str
) -> tuple[dict[str, Any], float] | None:
    """(entry of the map, share) of positions that move as the speed says, at any scale; None without any."""
    taken = {motion.speed, motion.r, motion.ay, steering}
    if motion.speed not in grid.mean or {"position", "lat_lon"} & set(grid.made.get(motion.speed, {})):
        return None
    best: tuple[float, dict[str, Any]] = (LINK, {})
    for ground in _grounds(grid):
        if not taken & set(ground.name.split(", ")):
            slope = ground.mean_speed if ground.made is ground.place else means(_path_speed(grid, ground))
            _, share = relation(slope, np.abs(grid.mean[motion.speed]))
            best = max(best, (share, ground.place), key=lambda pair: pair[0])
    return (best[1], best[0]) if best[1] else None


def _path_speed(grid: ColumnGrid, ground: _Ground) -> Array:
    """Speed (n,) of two position columns in m."""
    return np.hypot(*(grid.dot[name] for name in ground.place["position"]))


def yaw_rate_of(grid: ColumnGrid, motion: MotionColumns) -> Array:
    """The yaw rate (n,) in the unit of its column."""
    return grid.dot[motion.r] if motion.r == motion.heading else grid.x[motion.r]


def _with_acceleration(grid: ColumnGrid, motion: MotionColumns, moving: NDArray[np.bool_]) -> MotionColumns:
    """With the lateral acceleration, and the units and signs that all relations together make likely."""
    vr = means(np.abs(grid.x[motion.speed]) * yaw_rate_of(grid, motion))
    taken = {motion.r, motion.speed, *motion.position.split(", ")}
    best = (0.0, "", (0.0, 0.0))
    tilted, known = "along" in grid.made.get(motion.r, {}), speed_is_known(grid, motion)
    if tilted:
        for name, link in add_sideways(grid, motion.r, motion.speed, vr, moving):
            best = max(best, (link[1], name, link))
    for name in () if tilted else grid.dot:
        own = name_weight("ay", name)
        named = own or name_weight("ax", name)
        if name in taken or name in grid.made or name in grid.period or not (named or says_nothing(name)):
            continue
        k, share = relation(grid.mean[name], vr, moving[::EVERY])
        odds = grid.odds("ay", name) + (fit_odds(share) if share > WEAK else 0.0)
        fits = share > LINK and (named or (known and _is_unit_of_acceleration(k)))
        if odds > best[0] and (own or fits):  # of a sensor that is mounted turned, only if it fits
            best = (odds, name, (k, share))
    found = replace(motion, ay=best[1], links={**motion.links, "V r": best[2]} if best[1] else motion.links)
    return _with_units(grid, found)


def _with_units(grid: ColumnGrid, motion: MotionColumns) -> MotionColumns:
    """The units of speed, yaw rate and acceleration with the least contradictions."""
    links, told = dict(motion.links), {}
    if not grid.timed:  # the scales of slopes say nothing then
        links = {"V r": links["V r"]} if "V r" in links else {}
    for role in ("r", "speed", "ay"):
        name = getattr(motion, role)
        told[role] = unit_in(grid.made.get(name, {}).get("columns", [name])[0])
    made = motion.r == motion.heading
    if made and told["r"] in ("rad", "deg"):
        told["r"] = f"{told['r']}/s"
    if made and motion.r in grid.made:
        told["r"] = "rad/s"
    heading = _angle_unit(grid, motion.heading)
    gravity = _gravity_unit(grid, motion.ay)
    costs: list[tuple[float, dict[str, str]]] = []
    rate, speed = np.abs(yaw_rate_of(grid, motion)), np.abs(grid.x[motion.speed])
    vr = float(np.percentile(speed * rate, 99))
    moving, known = moving_parts(grid, motion.speed), speed_is_known(grid, motion)
    curvature = float(np.percentile(rate[moving] / speed[moving], 99)) if moving.any() else 0.0
    for v, r, a in product(SPEED_UNITS, RATE_UNITS, ACCELERATION_UNITS):
        fv, fr, fa = FACTORS["m/s"][v], FACTORS["rad/s"][r], FACTORS["m/s^2"][a]
        cost = SPEED_UNITS[v] + RATE_UNITS[r] + ACCELERATION_UNITS[a]
        cost += sum(
            2.0 for role, unit in (("speed", v), ("r", r), ("ay", a)) if told[role] and told[role] != unit
        )
        cost += 2.5 * (bool(gravity) and gravity != a)
        if made:
            cost += 3.0 * (bool(heading) and not heading.startswith(r[:3]))
        elif "heading" in links and heading:
            cost += 2 * abs(log(abs(links["heading"][0]) * fr / FACTORS["rad"][heading]))
        if "course" in links:
            cost += 2 * links["course"][1] * abs(log(abs(links["course"][0]) * fr))
        if "position" in links and links["position"][1] > 0.5:
            cost += 3 * abs(log(links["position"][0] / fv))
        k, share = links.get("V r", (0.0, 0.0))
        if known and share > WEAK:
            cost += 3 * share * abs(log(abs(k) * fa / (fv * fr)))
        elif not known:  # what a_y over the yaw rate says
            fv = abs(k) * fa / fr if share > WEAK else 0.0
            cost += 2 * max(0.0, log(fv / FASTEST), log(SLOWEST / fv)) if fv else 0.0
        if fv:
            cost += 2 * max(0.0, log((vr * fv * fr + 1e-9) / HARDEST)) + max(
                0.0, log(0.2 / (vr * fv * fr + 1e-9))
            )
            cost += 2 * max(0.0, log((curvature * fr / fv + 1e-9) * TIGHTEST))
        costs.append((cost, {"speed": v, "r": r, "ay": a}))
    costs.sort(key=lambda pair: pair[0])
    units = costs[0][1]
    rest = [cost for cost, other in costs if (other["speed"], other["r"]) != (units["speed"], units["r"])]
    turned = motion.links.get("course", (1.0, 0.0))[0] < 0
    return replace(motion, units=units, turned=turned, sure=rest[0] - costs[0][0])


def acceleration_units(grid: ColumnGrid, motion: MotionColumns) -> tuple[str, ...]:
    """The units in which a_y may be: of its name, of gravity, or in which it is V r; several without V."""
    name = motion.ay
    told = unit_in(grid.made.get(name, {}).get("columns", [name])[0])
    if told in ACCELERATION_UNITS or (told := _gravity_unit(grid, name)):
        return (told,)
    if speed_is_known(grid, motion):
        return (motion.units["ay"],)
    return tuple(u for u in ACCELERATION_UNITS if u != "g")


def _angle_unit(grid: ColumnGrid, name: str) -> str:
    """Of an angle: rad or deg by its wraps or its name, "" where neither says it."""
    if name in grid.made:
        return "rad"
    if period := grid.period.get(name):
        return "deg" if period == 360 else "rad"
    unit = unit_in(name)
    return unit if unit in FACTORS["rad"] else ""


def _gravity_unit(grid: ColumnGrid, name: str) -> str:
    """Of an acceleration: the unit in which the vertical one beside it is gravity, "" without one."""
    if not name:
        return ""
    if name in grid.made:
        return gravity(grid, grid.made[name]["columns"])[1]
    same = [n for n in grid.dot if grid.stream[n] == grid.stream[name] and n != name]
    z = ["z".join(words_of(name).rsplit(axis, 1)) for axis in "xy"]
    vertical = [n for n in same if words_of(n) in z]
    level = abs(float(np.mean(grid.raw[vertical[0]]))) if vertical else 0.0
    return "m/s^2" if 8 < level < 11.5 else "g" if 0.8 < level < 1.2 else ""
