"""Sensors in any orientation: gravity says what is up, the speed says what is left."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from rover_sweep.data.recording import Array
from rover_sweep.logs.readers.column_grid import EVERY, ColumnGrid, relation
from rover_sweep.logs.readers.column_names import name_weight, without_unit, words_of

LEVEL = 0.94  # share of gravity along z, from which the sensor counts as mounted flat: 20 degrees


def add_upright(grid: ColumnGrid) -> None:
    """Adds the yaw rate of each gyro that is not mounted flat: its component along gravity's mean direction.

    The acceleration is that of a sensor at rest which reads +g upward (specific force).
    """
    for acceleration in list(_triples(grid, "ay", r"\b(acc\w*|grav\w*)")):
        mean, unit = gravity(grid, acceleration)
        if not unit or abs(mean[2]) > LEVEL * np.linalg.norm(mean):
            continue
        up = mean / np.linalg.norm(mean)
        for gyro in list(_triples(grid, "p", r"\b(gyr\w*|omega|rotation)")):
            _add(grid, f"{', '.join(gyro)} upward", gyro, up)
        return


def add_sideways(
    grid: ColumnGrid, yaw_rate: str, speed: str, vr: Array, moving: NDArray[np.bool_]
) -> Iterator[tuple[str, tuple[float, float]]]:
    """(column of the acceleration to the left, its relation to V r) of a sensor that is not mounted flat.

    Left is where it agrees with V r, or forward with the change of speed, whichever fits better. vr: means of
    |V| r on the grid, in the columns' units.
    """
    up = np.array(grid.made[yaw_rate]["along"])
    one = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    one /= np.linalg.norm(one)
    level = np.stack((one, np.cross(up, one)))
    for names in list(_triples(grid, "ay", r"\bacc\w*")):
        means = np.stack([grid.mean[n] for n in names])
        found = []
        for turns, cause in ((True, vr), (False, grid.mean_dot.get(speed, 0 * vr))):
            along = np.array([relation(axis @ means, cause, moving[::EVERY])[0] for axis in level]) @ level
            along /= np.linalg.norm(along) + 1e-12
            share = relation(along @ means, cause)[1]
            found.append((share, along if turns else np.cross(up, along)))
        _, left = max(found, key=lambda each: each[0])
        title = _add(grid, f"{', '.join(names)} to the left of {speed} and {yaw_rate}", names, left)
        yield title, relation(grid.mean[title], vr, moving[::EVERY])


def gravity(grid: ColumnGrid, names: Sequence[str]) -> tuple[Array, str]:
    """The mean (3,) of an acceleration, and the unit in which it is gravity, "" for none."""
    mean = np.array([float(np.mean(grid.x[name])) for name in names])
    size = float(np.linalg.norm(mean))
    return mean, "m/s^2" if 8.3 < size < 11.3 else "g" if 0.85 < size < 1.15 else ""


def _add(grid: ColumnGrid, title: str, names: Sequence[str], along: Array) -> str:
    weights = [round(float(w), 3) for w in along]
    x, dot = (sum(w * of[n] for w, n in zip(weights, names, strict=True)) for of in (grid.x, grid.dot))
    grid.make(title, {"columns": list(names), "along": weights}, names[0], np.asarray(x), np.asarray(dot))
    return title


def _triples(grid: ColumnGrid, role: str, words: str) -> Iterator[tuple[str, str, str]]:
    """Columns x, y, z of one stream, of which one is named for the role, or all by these words."""
    plain = {(grid.stream[n], without_unit(n).strip().lower()): n for n in grid.dot if n not in grid.made}
    for (stream, name), first in plain.items():
        for axes in ("xyz", "012"):
            ends = re.search(rf"{axes[0]}(\]?)$", name)
            if not ends:
                continue
            rest = [plain.get((stream, f"{name[: ends.start()]}{axis}{ends[1]}")) for axis in axes[1:]]
            if not all(rest):
                continue
            names = (first, *(str(n) for n in rest))
            if max(name_weight(role, n) for n in names) >= 0.6 or re.search(words, words_of(first)):
                yield names[0], names[1], names[2]
