"""The IMU's place in the vehicle file with the wrong sign: turned, the model fits better or is likelier.

a_y is measured at the IMU: a_y of the CG + x r' - z p', so that only the model's a_y can tell x and z. Tyre
stiffness and yaw inertia make up for a wrong x: 5 cm on the wrong side gave C 78 for 32 at a J_ave of 6.
The cost alone cannot show that; the yaw inertia, which came out as 2.5 times the rover's, does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from rover_sweep.data.geometry import Geometry
from rover_sweep.data.recording import Recording
from rover_sweep.identification.cost import Condition
from rover_sweep.identification.fit import FitResult, fit
from rover_sweep.identification.grouping import Settings, grouped
from rover_sweep.identification.model_results import NotPossible, Work, model_result

PLACED = ("roll-yaw", "bicycle")  # models in which the yaw inertia has a meaning
LEAST = 0.02  # m: a place nearer to the CG shows too little
NOISE = 2.0  # J_ave that chance gives
WORSE = 1.25  # times J_ave that the turned place may have, where the yaw inertia speaks for it
INERTIA = 1.5  # weight of ln(yaw inertia) against ln(J_ave)
SURE = 0.65  # sum of both: of 26 sound sets of runs with the IMU at +-3, 5 and 8 cm the largest is .55
USUAL = 0.75  # yaw inertia over m a b, where the vehicle file has none: rovers have .56 to .9


def wrong_place(found: FitResult, conditions: Sequence[Condition], geometry: Geometry) -> str:
    """What to correct in the vehicle file's imu position, '' where the other signs are no likelier."""
    tried = [
        (names, fit(found.structure.with_values(turned), conditions))
        for names, turned in _turned(found, geometry)
    ]
    sure = [(_gain(found, other, geometry), names, other) for names, other in tried]
    gain, names, best = max(sure, key=lambda t: t[0], default=(0.0, (), found))
    return _words(found, best, names, geometry) if gain > SURE else ""


def wrong_place_in(runs: Sequence[Recording], geometry: Geometry, model: str) -> str:
    """The same from runs that have `delta`, '' where the model has no IMU or cannot be identified."""
    groups = tuple(g for g in grouped(runs, Settings()) if not g.why_not())
    if model not in PLACED or not groups:
        return ""
    work = Work(groups, geometry, (), Settings(models=(model,)))
    try:
        return wrong_place(model_result(model, work).fit, work.conditions(), geometry)
    except NotPossible:
        return ""


def _gain(found: FitResult, other: FitResult, geometry: Geometry) -> float:
    """How much likelier the turned place is: the fall of ln J_ave and of the oddness of the yaw inertia."""
    if other.average > WORSE * found.average:
        return -np.inf
    likelier = _oddness(found, geometry) - _oddness(other, geometry)
    return float(np.log((found.average + NOISE) / (other.average + NOISE)) + INERTIA * likelier)


def _oddness(found: FitResult, geometry: Geometry) -> float:
    return abs(float(np.log(found["Izz"].value / _inertia(geometry))))


def _inertia(geometry: Geometry) -> float:
    """Yaw inertia [kg m^2] of the vehicle file, or the usual one of such a mass on such axles."""
    return geometry.yaw_inertia or USUAL * geometry.mass * geometry.a * geometry.b


def _words(found: FitResult, best: FitResult, names: tuple[str, ...], geometry: Geometry) -> str:
    axes = " and ".join(names)
    falls = "falls" if best.average < found.average else "hardly rises"
    source = "the vehicle file says" if geometry.yaw_inertia else "mass and axles suggest"
    return (
        f"the IMU's place has the wrong sign: with {axes} of imu.position the other way round, J_ave {falls} "
        f"from {found.average:.1f} to {best.average:.1f}, and the yaw inertia is {best['Izz'].value:.3g} in "
        f"place of {found['Izz'].value:.3g} kg m^2 ({source} {_inertia(geometry):.3g}); check the sign of "
        f"{axes} in the vehicle file"
    )


def _turned(found: FitResult, geometry: Geometry) -> Iterator[tuple[tuple[str, ...], dict[str, float]]]:
    """The signs that may be wrong, and the model's values with them turned."""
    known = {p.name for p in found.structure.parameters if not p.free}
    h = geometry.h or 0.0
    values = {
        "forward": {"imu_x": -geometry.imu_x},
        "down": {"imu_z": 2 * h - geometry.imu_z},  # the file counts from the sprung CG
    }
    far = {"forward": abs(geometry.imu_x) > LEAST, "down": abs(geometry.imu_z - h) > LEAST}
    usable = [n for n, change in values.items() if far[n] and set(change) <= known]
    for names in (c for size in (1, 2) for c in combinations(usable, size)):
        yield names, {k: x for n in names for k, x in values[n].items()}
