"""The IMU's place in the vehicle file with the wrong sign: with the other sign the model fits far better.

a_y is measured at the IMU: a_y of the CG + x r' - z p', so that only the model's a_y can tell x and z.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

from rover_sweep.identify.fit import Condition, FitResult, fit
from rover_sweep.identify.geometry import Geometry

LEAST = 0.02  # m: a place nearer to the CG shows too little
BETTER, MATTERS = 0.5, 4.0  # of J_ave, and of its fall, that another sign must bring


def wrong_place(found: FitResult, conditions: Sequence[Condition], geometry: Geometry) -> str:
    """What to correct in the vehicle file's imu position, '' where the other signs fit no better."""
    tried = [
        (names, fit(found.structure.with_values(turned), conditions))
        for names, turned in _turned(found, geometry)
    ]
    if not tried:
        return ""
    names, best = min(tried, key=lambda t: t[1].average)
    if best.average > BETTER * found.average or found.average - best.average < MATTERS:
        return ""
    axes = " and ".join(names)
    return (
        f"the IMU's place has the wrong sign: with {axes} of imu.position the other way round, J_ave falls "
        f"from {found.average:.1f} to {best.average:.1f}; check the sign of {axes} in the vehicle file"
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
