"""Detects a wrong sign in the IMU's position of the vehicle file: the reversed position gives a better model.

a_y is measured at the IMU: a_y of the CG + x r' - z p', so only a_y depends on x and z. A wrong x changes the
identified tyre stiffness and yaw inertia instead of the fit: 5 cm with the wrong sign gave C = 78 instead of
32 N/rad at J_ave = 6. The cost alone does not show it, but the yaw inertia does: it was 2.5 times too large.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from rover_sweep.data.geometry import Geometry
from rover_sweep.identification.cost import Condition
from rover_sweep.identification.fit import FitResult, fit
from rover_sweep.identification.grouping import Group, Settings
from rover_sweep.identification.model_results import NotPossible, Work, model_result

PLACED = ("roll-yaw", "bicycle")  # models with a physical yaw inertia
MIN_DISTANCE = 0.02  # m from the CG: the effect of a smaller one is too small
NOISE = 2.0  # J_ave of a perfect model with noise
MAX_RISE = 1.25  # of J_ave, up to which a better yaw inertia still decides
INERTIA = 1.5  # weight of ln(yaw inertia) against ln(J_ave)
THRESHOLD = 0.65  # of the score; the largest of 26 correct cases (IMU at +-3, 5, 8 cm) is .55
INERTIA_RATIO = 0.75  # yaw inertia over m a b when the vehicle file has none; rovers have .56 to .9


def wrong_place(found: FitResult, conditions: Sequence[Condition], geometry: Geometry) -> str:
    """A sentence on what to correct in imu.position of the vehicle file, '' if the signs are plausible."""
    tried = [
        (names, fit(found.structure.with_values(reversed_values), conditions))
        for names, reversed_values in _reversed_signs(found, geometry)
    ]
    scores = [(_score(found, other, geometry), names, other) for names, other in tried]
    score, names, best = max(scores, key=lambda t: t[0], default=(0.0, (), found))
    return _sentence(found, best, names, geometry) if score > THRESHOLD else ""


def wrong_place_in(found: Sequence[Group], geometry: Geometry, model: str) -> str:
    """The same from groups of runs; '' when the model has no IMU position or cannot be identified."""
    groups = tuple(g for g in found if not g.why_not())
    if model not in PLACED or not groups:
        return ""
    work = Work(groups, geometry, (), Settings(models=(model,)))
    try:
        return wrong_place(model_result(model, work).fit, work.conditions(), geometry)
    except NotPossible:
        return ""


def _score(found: FitResult, other: FitResult, geometry: Geometry) -> float:
    """Score of the reversed position: decrease of ln J_ave plus that of the yaw inertia's log error."""
    if other.average > MAX_RISE * found.average:
        return -np.inf
    improvement = _inertia_error(found, geometry) - _inertia_error(other, geometry)
    return float(np.log((found.average + NOISE) / (other.average + NOISE)) + INERTIA * improvement)


def _inertia_error(found: FitResult, geometry: Geometry) -> float:
    """|ln(identified yaw inertia / expected)|."""
    return abs(float(np.log(found["Izz"].value / _inertia(geometry))))


def _inertia(geometry: Geometry) -> float:
    """Expected yaw inertia [kg m^2]: that of the vehicle file, or typical for this mass and these axles."""
    return geometry.yaw_inertia or INERTIA_RATIO * geometry.mass * geometry.a * geometry.b


def _sentence(found: FitResult, best: FitResult, names: tuple[str, ...], geometry: Geometry) -> str:
    axes = " and ".join(names)
    change = "falls" if best.average < found.average else "hardly rises"
    source = "the vehicle file says" if geometry.yaw_inertia else "mass and axles suggest"
    return (
        f"the IMU's position has the wrong sign: with {axes} of imu.position reversed, J_ave {change} "
        f"from {found.average:.1f} to {best.average:.1f}, and the yaw inertia {best['Izz'].value:.3g}, not "
        f"{found['Izz'].value:.3g} kg m^2 ({source} {_inertia(geometry):.3g}); check the sign of "
        f"{axes} in the vehicle file"
    )


def _reversed_signs(
    found: FitResult, geometry: Geometry
) -> Iterator[tuple[tuple[str, ...], dict[str, float]]]:
    """(axes whose sign is reversed, parameter values with these signs) for each combination to try."""
    known = {p.name for p in found.structure.parameters if not p.free}
    h = geometry.h or 0.0
    values = {
        "forward": {"imu_x": -geometry.imu_x},
        "down": {"imu_z": 2 * h - geometry.imu_z},  # the file counts from the sprung CG
    }
    far = {"forward": abs(geometry.imu_x) > MIN_DISTANCE, "down": abs(geometry.imu_z - h) > MIN_DISTANCE}
    usable = [n for n, change in values.items() if far[n] and set(change) <= known]
    for names in (c for size in (1, 2) for c in combinations(usable, size)):
        yield names, {k: x for n in names for k, x in values[n].items()}
